"""The integrator and the step that keep a tolerance at the least cost."""
