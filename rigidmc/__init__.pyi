"""What `import rigidmc` has, for type checkers; `python -m bench.stub --write` makes it."""

from os import PathLike

from xarray import Dataset

from rigidmc import protocols as protocols
from rigidmc.errors import FileError as FileError
from rigidmc.errors import NoDevice as NoDevice
from rigidmc.errors import OptionError as OptionError
from rigidmc.errors import OutputExists as OutputExists
from rigidmc.errors import PartError as PartError
from rigidmc.errors import RigidmcError as RigidmcError
from rigidmc.errors import SceneError as SceneError
from rigidmc.errors import SceneWarning as SceneWarning
from rigidmc.mechanics.euler_rates import euler_rates as euler_rates
from rigidmc.mechanics.euler_rates import omega_from_euler_rates as omega_from_euler_rates
from rigidmc.mechanics.free_top import analyse_free_top as analyse_free_top
from rigidmc.mechanics.free_top import solve_free_top as solve_free_top
from rigidmc.mechanics.lagrange_steady import effective_potential as effective_potential
from rigidmc.mechanics.lagrange_steady import least_spin as least_spin
from rigidmc.mechanics.lagrange_steady import steady_precession as steady_precession
from rigidmc.mechanics.lagrange_steady import tilt_growth as tilt_growth
from rigidmc.mechanics.lagrange_top import analyse_lagrange_top as analyse_lagrange_top
from rigidmc.mechanics.lagrange_top import solve_lagrange_top as solve_lagrange_top
from rigidmc.physics.effects.bath import Bath as Bath
from rigidmc.physics.effects.damping import AxialDamping as AxialDamping
from rigidmc.physics.effects.damping import DryFriction as DryFriction
from rigidmc.physics.effects.damping import MatrixDamping as MatrixDamping
from rigidmc.physics.effects.damping import QuadraticDrag as QuadraticDrag
from rigidmc.physics.effects.damping import ViscousDamping as ViscousDamping
from rigidmc.physics.effects.dissipation import EnergyDissipation as EnergyDissipation
from rigidmc.physics.effects.dissipation import InternalDissipation as InternalDissipation
from rigidmc.physics.effects.field import RotatingField as RotatingField
from rigidmc.physics.effects.field import UniformField as UniformField
from rigidmc.physics.effects.gravity import Gravity as Gravity
from rigidmc.physics.effects.gravity_gradient import GravityGradient as GravityGradient
from rigidmc.physics.effects.pivot import MovingPivot as MovingPivot
from rigidmc.physics.effects.potential import Potential as Potential
from rigidmc.physics.effects.reaction_wheel import ReactionWheel as ReactionWheel
from rigidmc.physics.effects.rotor import Rotor as Rotor
from rigidmc.physics.effects.spring import Spring as Spring
from rigidmc.physics.effects.torques import BodyTorque as BodyTorque
from rigidmc.physics.effects.torques import PeriodicTorque as PeriodicTorque
from rigidmc.physics.effects.torques import SpaceTorque as SpaceTorque
from rigidmc.physics.observables import Flips as Flips
from rigidmc.physics.observables import Histogram as Histogram
from rigidmc.physics.observables import OrbitAngles as OrbitAngles
from rigidmc.physics.observables import Passage as Passage
from rigidmc.physics.observables import PointingAngle as PointingAngle
from rigidmc.runs.prepare import PreparedRun as PreparedRun
from rigidmc.runs.rerun import rerun as rerun
from rigidmc.runs.simulate import precompile as precompile
from rigidmc.runs.simulate import prepare as prepare
from rigidmc.runs.simulate import simulate as simulate
from rigidmc.scene.body import Body as Body
from rigidmc.scene.distributions import common as common
from rigidmc.scene.distributions import distribution as distribution
from rigidmc.scene.distributions import normal as normal
from rigidmc.scene.distributions import uniform as uniform
from rigidmc.scene.mixtures import mixture as mixture
from rigidmc.scene.quantities import grid as grid
from rigidmc.scene.scene import Scene as Scene
from rigidmc.scene.settings import Run as Run
from rigidmc.scene.start import Start as Start
from rigidmc.scene.vector_distributions.attitudes import Fisher as Fisher
from rigidmc.scene.vector_distributions.attitudes import Pointing as Pointing
from rigidmc.scene.vector_distributions.bodies import SecondMoments as SecondMoments
from rigidmc.scene.vector_distributions.bodies import UncertainInertia as UncertainInertia
from rigidmc.scene.vector_distributions.ensembles import GibbsMomentum as GibbsMomentum
from rigidmc.scene.vector_distributions.ensembles import Shell as Shell
from rigidmc.scene.vector_distributions.tensors import TensorRows as TensorRows
from rigidmc.scene.vector_distributions.vectors import Cone as Cone
from rigidmc.scene.vector_distributions.vectors import Correlated as Correlated
from rigidmc.scene.vector_distributions.vectors import Sphere as Sphere
from rigidmc.studies.accuracy.study import accuracy as accuracy
from rigidmc.studies.basins.study import basins as basins
from rigidmc.studies.design.study import design as design
from rigidmc.studies.fit.study import fit as fit
from rigidmc.studies.frequencies.study import frequencies as frequencies
from rigidmc.studies.ftle.study import ftle as ftle
from rigidmc.studies.gradient.study import gradient as gradient
from rigidmc.studies.linearise.study import linearise as linearise
from rigidmc.studies.lyapunov.study import lyapunov as lyapunov
from rigidmc.studies.multilevel.study import multilevel as multilevel
from rigidmc.studies.propagate.study import propagate as propagate
from rigidmc.studies.rare.study import rare as rare
from rigidmc.studies.reweight import reweight as reweight
from rigidmc.studies.section.study import section as section
from rigidmc.studies.sensitivity.study import sensitivity as sensitivity
from rigidmc.studies.stability_map.stored import zoom_map as zoom_map
from rigidmc.studies.stability_map.study import stability_map as stability_map
from rigidmc.studies.stress.study import stress as stress
from rigidmc.studies.totals import simulate_totals as simulate_totals
from rigidmc.studies.until import estimate_rqmc as estimate_rqmc
from rigidmc.studies.until import simulate_until as simulate_until
from rigidmc.views.live.page import live as live

__version__: str

def open(path: str | PathLike[str], allow_code: bool = ...) -> Dataset: ...
