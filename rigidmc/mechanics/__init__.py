"""Rigid-body mechanics for arrays: inertia, rotations, coordinates and closed forms.

This is the textbook: each function takes arrays with components last and any leading shapes that
broadcast, and names its equation. The closed forms are the reference for everything that is
integrated, so no integrator is used here.

Reading order: `rotation` (quaternions, matrices, Euler angles), `inertia`, `solids` and `mesh`
(bodies), `log_cholesky` (the inertia of a body as ten numbers), `coordinates` (generalised
coordinates and the torques of potentials); then the free top: `textbook` (its omega as books have
it, and elliptic functions), `jacobi` (these as formulas), `free_orbit` (a motion as formulas),
`free_top` (for arrays); then the heavy ones: `lagrange_limits`, `lagrange_orbit`, `lagrange_top`,
and `integrable_tops` (Kovalevskaya, Goryachev-Chaplygin, Staude, Grioli).

Formulas are written without a subtraction that cancels and have no branch on a rounded number; the
tests compare them with mpmath. A member's bits in `closed` runs follow from their order of
operations.
"""
