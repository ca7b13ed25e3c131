"""Hard cases: how far each integrator is from the truth in them."""
