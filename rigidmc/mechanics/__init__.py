"""Rigid-body mechanics for arrays: inertia, rotations, coordinates and closed forms.

This is the textbook: each function accepts arrays with components last and any leading shapes that
broadcast, and cites its equation. The closed forms are the reference for all integrations, so this
package uses no integrator.

Reading order: `euler_angles` (all 12 sequences), `rotation` (quaternions, matrices, Euler angles),
`euler_rates` (rates of Euler angles, and omega), `inertia`, `density`, `solids`, `mesh` (bodies),
`axes_rates` (how principal axes change with a tensor), `impossible` (why a body cannot exist),
`log_cholesky` (the inertia of a body as ten numbers), `coordinates` (generalised coordinates and
the torques of potentials); then the free top: `textbook` (omega as in textbooks, and elliptic
functions), `jacobi` (elliptic functions as formulas), `free_orbit` (the motion as formulas),
`free_top` (for arrays); then heavy tops: `lagrange_limits`, `lagrange_orbit`, `lagrange_top`,
`lagrange_steady` (effective potential, steady motions, stability), and `integrable_tops`
(Kovalevskaya, Goryachev-Chaplygin, Grioli).

The formulas contain no cancelling subtraction and no branch on a rounded number; the tests compare
them with mpmath. Their order of operations determines a member's bits in `closed` runs.
"""
