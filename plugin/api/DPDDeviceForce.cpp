#include "DPDDeviceForce.h"
#include "openmm/AndersenThermostat.h"
#include "openmm/CMMotionRemover.h"
#include "openmm/MonteCarloAnisotropicBarostat.h"
#include "openmm/MonteCarloBarostat.h"
#include "openmm/MonteCarloFlexibleBarostat.h"
#include "openmm/MonteCarloMembraneBarostat.h"
#include "openmm/NonbondedForce.h"
#include "openmm/OpenMMException.h"
#include "openmm/serialization/SerializationNode.h"
#include "openmm/serialization/SerializationProxy.h"
#include <algorithm>
#include <cmath>
#include <memory>
#include <set>
#include <sstream>

using namespace DPDDevice;
using namespace OpenMM;
using namespace std;

atomic<long long> DPDDevice::bytesOfArrays(0);

extern "C" DPD_EXPORT long long dpdBytesOfArrays() {
    return bytesOfArrays;
}

double Fluid::maxCutoff() const {
    double most = *max_element(cutoff.begin(), cutoff.end());
    return cutoffCarried.empty() ? most : max(most, *max_element(cutoffCarried.begin(), cutoffCarried.end()));
}

double Fluid::rate(double kT) const {
    vector<double> sums(numTypes*numTypes, 0.0);
    for (size_t k = 0; k < gamma.size(); k++)
        sums[k%sums.size()] += max(sigma[k] < 0 ? gamma[k] : kT > 0 ? sigma[k]*sigma[k]/(2*kT) : 0.0, gammaAcross[k]);
    return *max_element(sums.begin(), sums.end());
}

void Fluid::check() const {
    size_t pairs = numTypes*numTypes;
    for (auto table : {&A, &gamma, &sigma, &gammaAcross, &exponent, &exponentAcross, &cutoff})
        if (numTypes < 1 || table->empty() || table->size()%pairs != 0 || table->size() != A.size())
            throw OpenMMException("DPDDeviceForce: a table of coefficients needs numTypes*numTypes values for each layer");
    for (auto table : {&B, &cutoffB, &cutoffDensity})
        if (table->size() != (B.empty() ? 0 : A.size()))
            throw OpenMMException("DPDDeviceForce: a table of many-body terms needs numTypes*numTypes values for each layer, or none");
    if (layers() > 1 && carries != NOTHING)
        throw OpenMMException("DPDDeviceForce: there is one layer where particles carry something");
    size_t rows = carries == NOTHING ? 0 : carries == HEAT ? 3 : 1+columns();
    if (carries < NOTHING || carries > SPECIES || carrying.size() != 4*rows*pairs || cutoffCarried.size() != (rows ? pairs : 0) ||
            carried.size() != columns()*types.size() || (columns() > 0) != (rows > 0) || (carries == HEAT && columns() != (states.empty() ? 1 : 2)) || columns() > 3*(TAKEN-RATES))
        throw OpenMMException("DPDDeviceForce: what particles carry needs a table, cutoffs, and as many values for each particle");
    if (capacities.size() != (carries == HEAT ? types.size() : 0) || sources.size()%12 != 0 || sources.size() > 12*32 || takes.size() != (sources.empty() ? 0 : types.size()))
        throw OpenMMException("DPDDeviceForce: heat capacities or sources, 32 at most, do not fit what particles carry");
    for (size_t k = 0; k < states.size() && k < 4*types.size(); k += 4)
        if (states.size() < 4*types.size() || (states.size()-4*types.size())%8 != 0 || carries != HEAT || lammps || !sources.empty() || states[k+1] < -2 ||
                (states[k+1] >= 0 && 4*types.size()+8*(states[k]+states[k+1]+1) > states.size()))
            throw OpenMMException("DPDDeviceForce: equations of state need four numbers for each particle, and eight for each piece and end of a curve");
    if (!densityWeights.empty() && densityWeights.size() != types.size())
        throw OpenMMException("DPDDeviceForce: densities need the weight of every particle");
    for (int type : types)
        if (type < -1 || type >= numTypes)
            throw OpenMMException("DPDDeviceForce: there is no such type");
    if (exceptionBeads.size() != 2*exceptionFactors.size())
        throw OpenMMException("DPDDeviceForce: each exception needs two particles and a factor");
    int last = 0;
    for (size_t k = 0; k < exceptionBeads.size(); k++) {
        if (exceptionBeads[k] < 0 || exceptionBeads[k] >= (int) types.size() || (k%2 == 0 && exceptionBeads[k] < last))
            throw OpenMMException("DPDDeviceForce: exceptions must be sorted by their first particle");
        last = k%2 == 0 ? exceptionBeads[k] : last;
    }
    if (!wallVelocity.empty() && wallVelocity.size() != 3*types.size())
        throw OpenMMException("DPDDeviceForce: velocities of immobile particles need three numbers for each particle");
    if (!walls.empty() && walls.size() != 15)
        throw OpenMMException("DPDDeviceForce: walls need 15 numbers");
    if (!wallMotion.empty() && (wallMotion.size() != 24 || walls.empty()))
        throw OpenMMException("DPDDeviceForce: the motion of walls needs 24 numbers, and walls");
    if (!behind.empty() && (behind.size()%(8*numTypes) != 0 || behind.size() < (size_t) 16*numTypes || wallMotion.empty() || behindAxis < 0 || behindAxis > 2 || !(behindReach > 0)))
        throw OpenMMException("DPDDeviceForce: what is behind walls needs two tables for each type, an axis, a reach, and the motion of the walls");
    if (!alone.empty() && (alone.size() != types.size() || bodyGroup < 0 || bodyGroup > 31))
        throw OpenMMException("DPDDeviceForce: where only one group acts is said of every particle, and of a group from 0 to 31");
    if (!shear.empty() && (shear.size() != 6 || !periodic || !walls.empty()))
        throw OpenMMException("DPDDeviceForce: a shear needs six numbers, a periodic box, and no walls");
    if (!(maxCutoff() > 0) || !(tolerance > 0 && tolerance < 1))
        throw OpenMMException("DPDDeviceForce: there must be a cutoff, and a tolerance between 0 and 1");
    if (fastGroups != -1 && slowKicks.size() != 2)
        throw OpenMMException("DPDDeviceForce: Forces beside the fast groups need two parts of a step over which they kick");
    for (auto& letter : word)
        if (string(word.size() == 1 ? "V" : "ABOS").find(letter.first) == string::npos)
            throw OpenMMException("DPDDeviceForce: the letters of a step are A, B, O and S, or V alone");
}

namespace {

// The groups in which another Force acts, none for what exerts no forces
int groupsOf(const Force& force) {
    bool exerts = dynamic_cast<const DPDDeviceForce*>(&force) == nullptr && dynamic_cast<const MonteCarloBarostat*>(&force) == nullptr &&
        dynamic_cast<const MonteCarloAnisotropicBarostat*>(&force) == nullptr && dynamic_cast<const MonteCarloFlexibleBarostat*>(&force) == nullptr &&
        dynamic_cast<const MonteCarloMembraneBarostat*>(&force) == nullptr && dynamic_cast<const AndersenThermostat*>(&force) == nullptr &&
        dynamic_cast<const CMMotionRemover*>(&force) == nullptr;
    auto* charges = dynamic_cast<const NonbondedForce*>(&force);
    int sum = charges == nullptr || charges->getReciprocalSpaceForceGroup() < 0 ? 0 : 1<<charges->getReciprocalSpaceForceGroup();
    return exerts ? 1<<force.getForceGroup()|sum : 0;
}

class DPDDeviceForceImpl : public ForceImpl {
public:
    DPDDeviceForceImpl(const DPDDeviceForce& owner) : owner(owner) { forceGroup = owner.getForceGroup(); }
    void initialize(ContextImpl& context) override {
        const System& system = context.getSystem();
        if ((int) owner.fluid.types.size() != system.getNumParticles())
            throw OpenMMException("DPDDeviceForce must name the type of every particle of the System");
        if (system.getNumParticles() >= 1<<24)
            throw OpenMMException("DPDDeviceForce: more than 16,777,215 particles have no exact number in single precision");
        owner.fluid.check();
        int ours = 0;
        for (int k = 0; k < system.getNumForces(); k++) {
            others |= groupsOf(system.getForce(k));
            ours += dynamic_cast<const DPDDeviceForce*>(&system.getForce(k)) != nullptr;
        }
        if (ours > 1)
            throw OpenMMException("DPDDeviceForce: there can be one in a System");
        constrained = system.getNumConstraints() > 0;
        for (int i = 0; i < system.getNumParticles(); i++)
            constrained |= system.isVirtualSite(i);
        kernel = context.getPlatform().createKernel(DPDDeviceKernel::Name(), context);
        kernel.getAs<DPDDeviceKernel>().initialize(system, owner);
    }
    const DPDDeviceForce& getOwner() const override { return owner; }
    void updateContextState(ContextImpl& context, bool& forcesInvalid) override {
        forcesInvalid |= kernel.getAs<DPDDeviceKernel>().wrap(context);
        if ((int) context.getParameter("dpd_phase") < RUN)
            return;
        if (constrained)
            throw OpenMMException("DPDDeviceForce: whole steps keep no constraints and no virtual sites");
        stepping = true;
        try {
            kernel.getAs<DPDDeviceKernel>().step(context, others&context.getIntegrator().getIntegrationForceGroups());
        }
        catch (...) {
            stepping = false;
            throw;
        }
        stepping = false;
        forcesInvalid = true;
    }
    double calcForcesAndEnergy(ContextImpl& context, bool includeForces, bool includeEnergy, int groups) override {
        if ((groups&(1<<forceGroup)) == 0 || stepping) // within a step this force is taken care of
            return 0.0;
        return kernel.getAs<DPDDeviceKernel>().execute(context, includeForces, includeEnergy);
    }
    void update(ContextImpl& context) {
        kernel.getAs<DPDDeviceKernel>().update(owner.fluid);
        context.systemChanged();
    }
    map<string, double> getDefaultParameters() override { return owner.fluid.globals; }
    vector<string> getKernelNames() override { return {DPDDeviceKernel::Name()}; }
private:
    const DPDDeviceForce& owner;
    Kernel kernel;
    int others = 0;
    bool constrained = false, stepping = false;
};

template <class T> string joined(const vector<T>& values) {
    stringstream s;
    s.precision(17);
    for (size_t i = 0; i < values.size(); i++)
        s << (i ? " " : "") << values[i];
    return s.str();
}

template <class T> void split(const SerializationNode& node, const string& name, vector<T>& values) {
    stringstream s(node.getStringProperty(name, ""));
    values.clear();
    for (T value; s >> value;)
        values.push_back(value);
    if (!s.eof())
        throw OpenMMException("DPDDeviceForce: "+name+" must be a list of numbers");
}

class DPDDeviceForceProxy : public SerializationProxy {
public:
    DPDDeviceForceProxy() : SerializationProxy("DPDDeviceForce") {}
    void serialize(const void* object, SerializationNode& node) const override {
        const DPDDeviceForce& force = *reinterpret_cast<const DPDDeviceForce*>(object);
        Fluid fluid = force.fluid;
        node.setIntProperty("version", !fluid.states.empty() || !fluid.alone.empty() || !fluid.wallMotion.empty() || !fluid.shear.empty() ? 4 : fluid.carries != NOTHING ? 3 : fluid.B.empty() ? 1 : 2);
        node.setIntProperty("forceGroup", force.getForceGroup());
        node.setStringProperty("name", force.getName());
        node.setBoolProperty("periodic", fluid.periodic);
        node.setBoolProperty("lammps", fluid.lammps);
        node.setDoubleProperty("tolerance", fluid.tolerance);
        node.setDoubleProperty("behindReach", fluid.behindReach);
        for (auto& item : numbers(fluid))
            node.setIntProperty(item.first, *item.second);
        for (auto& item : lists(fluid))
            node.setStringProperty(item.first, joined(*item.second));
        for (auto& item : tables(fluid))
            node.setStringProperty(item.first, joined(*item.second));
        string letters;
        vector<double> parts;
        for (auto& letter : fluid.word) {
            letters += letter.first;
            parts.push_back(letter.second);
        }
        node.setStringProperty("letters", letters);
        node.setStringProperty("parts", joined(parts));
        SerializationNode& globals = node.createChildNode("GlobalParameters");
        for (auto& item : fluid.globals)
            globals.createChildNode("Parameter").setStringProperty("name", item.first).setDoubleProperty("default", item.second);
    }
    void* deserialize(const SerializationNode& node) const override {
        if (node.getIntProperty("version") < 1 || node.getIntProperty("version") > 4)
            throw OpenMMException("Unsupported version number");
        unique_ptr<DPDDeviceForce> force(new DPDDeviceForce());
        force->setForceGroup(node.getIntProperty("forceGroup", 0));
        force->setName(node.getStringProperty("name", force->getName()));
        Fluid& fluid = force->fluid;
        fluid.periodic = node.getBoolProperty("periodic", true);
        fluid.lammps = node.getBoolProperty("lammps", false);
        fluid.tolerance = node.getDoubleProperty("tolerance", fluid.tolerance);
        fluid.behindReach = node.getDoubleProperty("behindReach", 0);
        for (auto& item : numbers(fluid))
            *item.second = node.getIntProperty(item.first, *item.second);
        for (auto& item : lists(fluid))
            split(node, item.first, *item.second);
        for (auto& item : tables(fluid))
            split(node, item.first, *item.second);
        string letters = node.getStringProperty("letters", "");
        vector<double> parts;
        split(node, "parts", parts);
        if (letters.size() != parts.size())
            throw OpenMMException("DPDDeviceForce: letters and parts of the word must be as many");
        for (size_t k = 0; k < letters.size(); k++)
            fluid.word.push_back({letters[k], parts[k]});
        for (auto& child : node.getChildren())
            if (child.getName() == "GlobalParameters")
                for (auto& item : child.getChildren())
                    fluid.globals[item.getStringProperty("name")] = item.getDoubleProperty("default");
        fluid.check();
        return force.release();
    }
private:
    static vector<pair<string, int*> > numbers(Fluid& fluid) {
        return {{"numTypes", &fluid.numTypes}, {"fastGroups", &fluid.fastGroups}, {"carries", &fluid.carries}, {"bodyGroup", &fluid.bodyGroup},
            {"behindAxis", &fluid.behindAxis}};
    }
    static vector<pair<string, vector<int>*> > lists(Fluid& fluid) {
        return {{"types", &fluid.types}, {"exceptionBeads", &fluid.exceptionBeads}, {"takes", &fluid.takes}, {"alone", &fluid.alone}};
    }
    static vector<pair<string, vector<double>*> > tables(Fluid& fluid) {
        return {{"A", &fluid.A}, {"gamma", &fluid.gamma}, {"sigma", &fluid.sigma}, {"gammaAcross", &fluid.gammaAcross}, {"exponent", &fluid.exponent},
            {"exponentAcross", &fluid.exponentAcross}, {"cutoff", &fluid.cutoff}, {"exceptionFactors", &fluid.exceptionFactors},
            {"B", &fluid.B}, {"cutoffB", &fluid.cutoffB}, {"cutoffDensity", &fluid.cutoffDensity}, {"densityWeights", &fluid.densityWeights},
            {"carrying", &fluid.carrying}, {"cutoffCarried", &fluid.cutoffCarried}, {"carried", &fluid.carried}, {"capacities", &fluid.capacities},
            {"states", &fluid.states}, {"sources", &fluid.sources}, {"wallVelocity", &fluid.wallVelocity}, {"walls", &fluid.walls}, {"wallMotion", &fluid.wallMotion}, {"behind", &fluid.behind}, {"shear", &fluid.shear}, {"slowKicks", &fluid.slowKicks}};
    }
};

}

DPDDeviceForce::DPDDeviceForce() {
    fluid.globals = {{"dpd_phase", 0}, {"dpd_dt", 1}, {"dpd_kT", 1}, {"dpd_seed", 0}, {"dpd_counter", 0}};
}

ForceImpl* DPDDeviceForce::createImpl() const {
    return new DPDDeviceForceImpl(*this);
}

void DPDDeviceForce::updateParametersInContext(Context& context) {
    fluid.check();
    dynamic_cast<DPDDeviceForceImpl&>(getImplInContext(context)).update(getContextImpl(context));
}

// For Python, which knows this class as a Force alone: repulsion and friction of one to another one, and to its Context; returns why not, or nothing
extern "C" DPD_EXPORT const char* dpdUpdate(const Force* from, Force* to, Context* context) {
    static thread_local string why;
    auto& force = dynamic_cast<DPDDeviceForce&>(*to);
    const Fluid before = force.fluid, &like = dynamic_cast<const DPDDeviceForce&>(*from).fluid;
    try {
        SerializationNode here, there;
        DPDDeviceForceProxy().serialize(to, here);
        DPDDeviceForceProxy().serialize(from, there);
        for (auto& item : here.getProperties())
            if (there.getStringProperty(item.first) != item.second && !set<string>{"A", "B", "gamma", "sigma", "gammaAcross", "carried"}.count(item.first))
                throw OpenMMException("DPDDeviceForce: "+item.first+" of a Context cannot change; make a new one");
        force.fluid = like;
        force.fluid.globals = before.globals;
        force.fluid.carried = before.carried;
        force.updateParametersInContext(*context);
        return "";
    }
    catch (const exception& error) {
        force.fluid = before;
        why = error.what();
        return why.c_str();
    }
}

extern "C" __attribute__((constructor)) void registerDPDDeviceProxies() {
    SerializationProxy::registerProxy(typeid(DPDDeviceForce), new DPDDeviceForceProxy());
}
