#ifndef DPD_FIELDS_H_
#define DPD_FIELDS_H_
// Launches of fields.cc: what beads carry, in arrays on a device.
#include "Arguments.h"
#include "Tables.h"
#include <string>

namespace DPDDevice {

class Fields {
public:
    using Array = Device::Array;
    using Base = Device::Base;

    Fields(Device& device, const Fluid& fluid) : device(device), fluid(fluid) {
        int beads = device.beads();
        blocks = fluid.carries == NOTHING ? 1 : (fluid.columns()+2)/3;
        std::vector<std::array<double, 4> > values(fluid.carries == NOTHING ? 1 : blocks*beads, {0, 0, 0, 0});
        double typical = 0, capacity = 0;
        for (size_t k = 0; k < fluid.carried.size(); k++) {
            int column = k%fluid.columns();
            values[column/3*beads+k/fluid.columns()][column%3] = fluid.carried[k];
            typical += std::fabs(fluid.carried[k])/beads;
        }
        for (double each : fluid.capacities)
            capacity += each/beads;
        if (fluid.carries == HEAT)
            typical *= capacity;
        // sums have 32 bits behind the point: what a bead has flows two million times in a unit of time before they are too large
        unit = typical > 0 ? std::ldexp(1.0, (int) std::floor(std::log2(typical))-10) : 1.0;
        double fastest = 0, largest = fluid.capacities.empty() ? 1 : *std::max_element(fluid.capacities.begin(), fluid.capacities.end());
        for (size_t k = fluid.carries == SPECIES ? 4 : 0; k < fluid.carrying.size(); k += fluid.carries == HEAT ? 12 : 4)
            fastest = std::max(fastest, largest*std::fabs(fluid.carrying[k]));
        rateUnit = fastest > 0 ? std::ldexp(1.0, (int) std::floor(std::log2(fastest))-10) : 1.0;
        device.fill(carrying, Kind::Real4, inRows(fluid.carrying));
        device.fill(sources, Kind::Mixed4, inRows(fluid.sources));
        device.fill(states, Kind::Mixed4, inRows(fluid.states));
        for (auto array : {&own, &shown, &rates})
            device.fill(*array, Kind::Mixed4, values);
        device.fill(rates, Kind::Mixed4, std::vector<std::array<double, 4> >(values.size(), {0, 0, 0, 0}));
        std::vector<double> capacities = fluid.capacities;
        capacities.resize(std::max<size_t>(1, capacities.size()), 1);
        device.fill(this->capacities, Kind::Real, capacities);
        std::vector<int> takes = fluid.takes;
        takes.resize(std::max<size_t>(1, takes.size()), 0);
        device.fill(this->takes, Kind::Int, takes);
    }

    // What is shown to friction, flows and forces that follow it: what beads have, and then own += half*rates
    template <class Stop> void advance(Stop stop, double half, double predict) {
        for (int block = 0; block < blocks && fluid.carries != NOTHING; block++)
            device.run<dpdAdvance_>(stop(), device.velm(), device.index(), own, rates, shown, states, block, Mixed{half}, Mixed{predict});
    }

    // Rates at positions in cells, and then own += half*rates
    template <class Stop, class Position, class Terms, class Cells, class Box> void flow(Stop stop, Position position, Base& vel, Terms terms, Cells cells, Box box,
            double dt, double half) {
        for (int block = 0; block < blocks && fluid.carries != NOTHING; block++)
            device.run<dpdCarry_>(stop(), position, terms, cells, box, together(SOURCES_OF(GIVE)), vel, own, rates, capacities, block,
                Real{1/std::sqrt(dt)}, Real{1/unit}, Mixed{half});
    }

    // Velocities change places with block `number`-FIELDS of what beads have, or `number`-RATES of its rates
    template <class Stop> void swap(Stop stop, int number) {
        bool rate = number >= RATES;
        number -= rate ? RATES : FIELDS;
        if (number < blocks && fluid.carries != NOTHING)
            device.run<dpdSwap_>(stop(), device.velm(), device.index(), rate ? rates : own, number);
    }

    // A sweep over a time at positions in cells, from pair to pair; sources act for a half of it before and after.  Rows, and how many rounds there are,
    // are the engine's.
    template <class Stop, class Position, class Terms, class Cells, class Box> void sweep(Stop stop, Position position, Terms terms, Cells cells, Box box,
            Array& rowCount, Array& rows, int rowRoom, int rounds, bool exact, double time, double kT) {
        give(stop, position, box, 0.5*time);
        list(stop, position, terms, cells, box, rowCount, rows, rowRoom);
        device.run<dpdSort_>(stop(), rowCount, rows, distances, hashes);
        for (int round = 0; round <= rounds; round++)
            device.run<dpdRound_>(stop(), terms, together(PAIRS_OF(GIVE, READS)), states, device.velm(), own, heads[round%2], heads[1-round%2],
                Mixed{time}, Mixed{kT}, (int) exact, (int) (round == rounds));
        give(stop, position, box, 0.5*time);
        advance(stop, 0, 0);
    }

    // Rows of pairs; without any room they are only counted
    template <class Stop, class Position, class Terms, class Cells, class Box> void list(Stop stop, Position position, Terms terms, Cells cells, Box box,
            Array& rowCount, Array& rows, int rowRoom) {
        device.run<dpdPairs_>(stop(), position, terms, cells, box, together(PAIRS_OF(GIVE, READS)), hashes, device.velm(), heads[0], rowRoom,
            Real{1/rateUnit});
    }

    void makeRows(size_t places) {
        if (fluid.carries == NOTHING)
            return;
        device.make(distances, Kind::Real, places);
        device.make(hashes, Kind::Long, places);
        device.make(around, Kind::Mixed4, device.padded());
        for (auto& array : heads)
            device.make(array, Kind::Int, device.padded());
    }

    Array carrying, own, shown;

private:
    template <class Stop, class Position, class Box> void give(Stop stop, Position position, Box box, double time) {
        if (!fluid.sources.empty())
            device.run<dpdGive_>(stop(), position, together(SOURCES_OF(GIVE)), box, device.velm(), device.index(), own, Mixed{time});
    }

    Device& device;
    const Fluid& fluid;
    int blocks;
    double unit, rateUnit; // of flows in sums, and of rates of exchange
    Array rates, capacities, states, sources, takes, distances, hashes, around, heads[2];
};

}
#endif
