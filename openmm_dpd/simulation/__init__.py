"""A plan becomes a System, an integrator and a Simulation; steps, and what may change between them."""
