"""Hard cases, and how far each integrator is from the truth in them."""
