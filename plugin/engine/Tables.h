#ifndef DPD_TABLES_H_
#define DPD_TABLES_H_
// Numbers that the kernels look up.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <initializer_list>
#include <vector>

namespace DPDDevice {

// Numbers four by four, one row at least
inline std::vector<std::array<double, 4> > inRows(const std::vector<double>& numbers) {
    std::vector<std::array<double, 4> > rows(std::max<size_t>(1, numbers.size()/4));
    for (size_t k = 0; k < numbers.size(); k++)
        rows[k/4][k%4] = numbers[k];
    return rows;
}

// Key of the noise of one evaluation: openmm_dpd/kernels/noise.py, call_key().
inline uint64_t callKey(std::initializer_list<uint64_t> words) {
    uint64_t key = 0;
    for (uint64_t word : words) {
        uint64_t z = key+word+0x9E3779B97F4A7C15ULL;
        z = (z^(z>>30))*0xBF58476D1CE4E5B9ULL;
        z = (z^(z>>27))*0x94D049BB133111EBULL;
        key = z^(z>>31);
    }
    return key;
}

inline uint64_t bitsOf(double x) {
    uint64_t bits;
    std::memcpy(&bits, &x, sizeof(bits));
    return bits;
}

// Layer 0 of the host (kernels.cc has the others); parts of a sweep that is carried out in several have numbers from 0 on.
inline uint64_t noiseKey(uint64_t seed, uint64_t counter, double kT, int part) {
    return part == 0 ? callKey({seed, counter, 0, bitsOf(kT)}) : callKey({seed, counter, 0, bitsOf(kT), (uint64_t) part});
}

// Cubics in the cells of the inverse normal distribution function: openmm_dpd/kernels/noise.py, _cubics().  Values at the edges are rounded there
// and here to 39 bits after the point, so that they are the same whichever library found them.
inline std::vector<std::array<double, 4> > normalCubics() {
    const int smooth = 248;
    const double width = 0.5/256, unit = std::ldexp(1.0, -39), root2 = std::sqrt(2.0), root2pi = std::sqrt(2*3.14159265358979323846);
    std::vector<double> value(smooth+1), slope(smooth+1);
    for (int k = 0; k <= smooth; k++) {
        double above = 0.5-width*k, z = k == 0 ? 0.0 : value[k-1]; // the probability of a larger number
        for (int pass = 0; pass < 50 && k > 0; pass++)
            z += (0.5*std::erfc(z/root2)-above)*root2pi*std::exp(0.5*z*z);
        value[k] = std::rint(z/unit)*unit;
        slope[k] = width*root2pi*std::exp(0.5*value[k]*value[k]);
    }
    std::vector<std::array<double, 4> > cubics(smooth);
    for (int k = 0; k < smooth; k++) {
        double rise = value[k+1]-value[k];
        cubics[k] = {value[k], slope[k], 3*rise-2*slope[k]-slope[k+1], slope[k]+slope[k+1]-2*rise};
    }
    return cubics;
}

// Chebyshev iteration for eigenvalues between 1 and 1 + x: `passes` corrections reduce the residual by the tolerance for x up to a limit, and have
// these weights, which do not depend on x.
const int MOST_PASSES = 64;

inline std::vector<double> passLimits(double tolerance) {
    std::vector<double> limits(MOST_PASSES+1, 0.0);
    for (int passes = 1; passes <= MOST_PASSES; passes++) {
        double rate = std::pow(tolerance, 1.0/passes), sigma = 0.5*(rate+1/rate);
        limits[passes] = 2/(sigma-1);
    }
    return limits;
}

inline std::vector<std::array<double, 4> > passWeights(const std::vector<double>& limits) {
    std::vector<std::array<double, 4> > weights((MOST_PASSES+1)*MOST_PASSES, {0, 0, 0, 0});
    for (int passes = 1; passes <= MOST_PASSES; passes++) {
        double half = 0.5*limits[passes], centre = 1+half, sigma = centre/half, rho = 1/sigma;
        for (int pass = 0; pass < passes; pass++) {
            double scale = pass == 0 ? 1/centre : 1.0, next = 1/(2*sigma-rho);
            weights[passes*MOST_PASSES+pass] = {scale, next*rho*scale, 2*next/half, 0};
            rho = next;
        }
    }
    return weights;
}

}
#endif
