#ifndef DPD_LAUNCH_H_
#define DPD_LAUNCH_H_
// The kernels by name, and kinds of numbers in their arguments.
#include <tuple>
#include <utility>

namespace DPDDevice {

// Kinds of numbers in arrays, and numbers whose type depends on the precision.
enum class Kind { Int, Real, Real4, Long, Mixed4 };
struct Real { double value; };
struct Mixed { double value; };
struct Mixed4 { double x, y, z, w; };

// Arguments as one tuple, of references to what stays: those that are tuples are taken apart.
template <class T> std::tuple<T&&> flat(T&& value) { return std::tuple<T&&>(std::forward<T>(value)); }
template <class... T> std::tuple<T...> together(T&&... values) { return std::tuple<T...>(std::forward<T>(values)...); }
template <class... T> std::tuple<T...> flat(std::tuple<T...> values) { return values; }

// Whether several threads may share a bead is said of each.
#define DPD_KERNELS(X) X(dpdMove, false) X(dpdDensity, true) X(dpdEvaluate, true) X(dpdKick, true) X(dpdRenew, false) X(dpdCompare, false) X(dpdExchange, false) X(dpdFollow, false) \
    X(dpdRows, true) X(dpdPass, true) X(dpdFinish, true) X(dpdCarry, true) X(dpdAdvance, false) X(dpdSwap, false) \
    X(dpdPairs, true) X(dpdSort, false) X(dpdRound, false) X(dpdGive, false)
#define DPD_TAG(name, share) struct name##_ { static constexpr const char* text = #name; static constexpr bool shared = share; };
DPD_KERNELS(DPD_TAG)
#undef DPD_TAG

}
#endif
