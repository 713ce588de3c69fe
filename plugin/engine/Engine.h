#ifndef DPD_ENGINE_H_
#define DPD_ENGINE_H_
// What OpenMM and programs ask for beside whole steps: forces and energies, one pair update, what is kept on the device, the momentum of walls.
#include "Steps.h"

namespace DPDDevice {

class Engine : public Steps {
public:
    using Steps::Steps;

    double execute(OpenMM::ContextImpl& context, bool includeForces, bool includeEnergy) {
        int phase = (int) context.getParameter("dpd_phase");
        if (phase >= EXCHANGE+TAKEN && phase < RUN)
            return phase == EXCHANGE+TAKEN+IMPULSES ? tell(context) : taken(phase-EXCHANGE-TAKEN);
        if (phase >= RUN) // a barostat asks
            phase = 0;
        bool inStep = phase == FORCE_SEEN || phase == FORCE_KEPT || phase >= SWEEP;
        Now now = at(context);
        fit();
        here = 0;
        owedSlow = 0;
        binned = standing = false;
        if (phase >= EXCHANGE+FIELDS) {
            fields.swap(stop(), phase%100);
            device.give();
            return 0.0;
        }
        if (phase >= SWEEP && phase < EXCHANGE && fluid.carries != NOTHING)
            throw OpenMM::OpenMMException("DPDDeviceForce: pair updates of what particles carry are those of whole steps alone");
        if (phase >= EXCHANGE) {
            needSeen();
            run<dpdExchange_>(place(), posB, corrB, device.velm(), phase%100 == 0 ? acc : seen);
            device.give();
            keep(now);
            return 0.0;
        }
        if (inStep)
            begin(now, phase >= SWEEP);
        if (phase >= SWEEP) {
            if (!thermostat || !includeForces)
                return 0.0;
            sweep(now, phase%100 == 0, 1, 0, 0, true);
            look(now, false);
            return device.result(true, false);
        }
        int terms = (phase != FORCE_KEPT && conservative ? 1 : 0)|(inStep && thermostat ? 2 : 0);
        if (!inStep && unseen)
            look(now, false, true);
        if (terms == 0)
            return 0.0;
        do { // outside a step there is time to look whether all beads found a place
            binned = false;
            bin(inStep ? now : Now{0, 0, 0, 0});
        } while (!inStep && look(now, true));
        sumDensities(now, here, terms);
        fields.advance(stop(), 0, 0);
        if (inStep)
            fields.flow(stop(), place(), device.velm(), termsOf(now, now.dt, 0), cellsOf(), boxOf(), now.dt, 0);
        run<dpdEvaluate_>(place(), termsOf(now, now.dt, 0), cellsOf(), driftOf(0), boxOf(), device.force(), device.energy(), terms);
        if (inStep)
            look(now, false);
        return device.result(includeForces, includeEnergy);
    }

    // Molecules that are far from the box go back into it, for digits of positions are few.  When that is is a matter of the count of steps, which
    // States and checkpoints have: no bit depends on calls of step() or restarts.
    bool wrap(OpenMM::ContextImpl& context) {
        if (!fluid.periodic || sheared() || context.getStepCount()%1000 != 0)
            return false;
        here = 0;
        bool known = haveKept && !moved();
        if (!device.wrap(context.getMolecules(), 1000*fluid.maxCutoff()))
            return false;
        standing = false;
        if (known) {
            device.copy(position(), posB);
            if (device.mixed())
                device.copy(correction(), corrB);
        }
        return true;
    }

private:
    // Momentum that a wall has taken up since this was asked last: a program adds it to a context parameter, which is what a restart has.
    double taken(int number) {
        if (std::exchange(pushed, false)) {
            std::vector<long long> now(IMPULSES);
            device.download(impulses, now);
            device.clear(impulses);
            for (int k = 0; k < IMPULSES; k++)
                untold[k] += now[k];
        }
        return std::ldexp((double) std::exchange(untold[number%IMPULSES], 0), -30);
    }

    // The same of all walls, added to the parameters: outside of a step, for a program keeps its own values of them
    double tell(OpenMM::ContextImpl& context) {
        for (int k = 0; k < IMPULSES; k++) {
            std::string name = std::string("dpd_wall_")+"xyz"[k/6]+(k/3%2 ? "_below_" : "_above_")+"xyz"[k%3];
            if (fluid.globals.count(name))
                context.setParameter(name, context.getParameter(name)+taken(k));
        }
        return 0;
    }
};

}
#endif
