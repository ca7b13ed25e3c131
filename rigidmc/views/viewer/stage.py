"""The two stages of the page as K3D plots: the body in space, and its momentum sphere.

The page moves objects by name; "0/polhode" belongs to the first of several bodies.
"""

from collections.abc import Iterable, Sequence
from typing import Any

import k3d
import numpy as np
from numpy.typing import ArrayLike, NDArray

from rigidmc.physics.effects.field import UniformField
from rigidmc.physics.effects.gravity import Gravity
from rigidmc.physics.effects.gravity_gradient import GravityGradient
from rigidmc.physics.effects.protocol import Effect
from rigidmc.scene.quantities import is_shared
from rigidmc.views.sphere import family
from rigidmc.views.surfaces import TONES, Surface, ball_surface, revolve, surface_radius
from rigidmc.views.viewer.data import MOST

Floats = NDArray[np.float64]

GREY, INK, PATH, PULL = 0xA8A8A8, 0x303030, 0xD94801, 0x2A9D6F
AXES = (0x2171B5, 0xB5651D, 0x7A7A7A)  # axes 1, 2, 3, in the tones of a box
STICK = ((0.0, 0.0), (0.008, 0.0), (0.008, 1.0), (0.0, 1.0))
ARROW = ((0.0, 0.0), (0.014, 0.0), (0.014, 0.86), (0.045, 0.86), (0.0, 1.0))
POINTS = MOST + 1  # points of the trace and of the path


def empty(eye: ArrayLike) -> Any:
    """Return a plot without grid, menu and helpers, seen from `eye` (3,) with axis 3 upward."""
    plot = k3d.plot(
        camera_auto_fit=False,
        grid_visible=False,
        menu_visibility=False,
        axes_helper=0,
        camera_mode="orbit",
        camera_fov=30.0,
        logarithmic_depth_buffer=False,
        antialias=1,
    )
    plot.camera = [*(1.7 * np.asarray(eye)), 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]
    return plot


def solid_surface(surface: Surface, name: str) -> Any:
    """Return a surface with a colour for each triangle."""
    tones = np.array([int(tone[1:], 16) for tone in TONES], dtype=np.uint32)
    return k3d.mesh(
        surface.corners[surface.faces].reshape(-1, 3).astype(np.float32),
        np.arange(3 * len(surface.faces), dtype=np.uint32).reshape(-1, 3),
        colors=np.repeat(tones[surface.tones], 3),
        side="double",
        name=name,
    )


def plain_surface(surface: Surface, color: int, name: str) -> Any:
    """Return a surface of one colour."""
    return k3d.mesh(
        surface.corners.astype(np.float32),
        surface.faces.astype(np.uint32),
        color=color,
        name=name,
    )


def line_plot(points: Floats, color: int, name: str) -> Any:
    """Return a line one pixel wide."""
    return k3d.line(np.asarray(points, dtype=np.float32), shader="simple", color=color, name=name)


def body_plot(surface: Surface, effects: Sequence[Effect]) -> Any:
    """Return the stage of a body at the origin, with its axes, the vertical, the momentum, and
    arrows for gravity and fields.

    The page gives the body the form of a member, fills the trace of axis 3, and turns everything.
    """
    plot = empty((1.9, -2.6, 1.1))
    # K3D sets the near plane of its camera by the size of its objects: a moon of 190 km at full
    # size would hide everything
    plot += solid_surface(
        surface._replace(corners=surface.corners / surface_radius(surface)), "body"
    )
    plot += plain_surface(revolve(*STICK, around=12), INK, "stick")
    for axis in range(3):
        plot += line_plot(np.outer([0.0, 1.2], np.eye(3)[axis]), AXES[axis], f"axis{axis + 1}")
    plot += line_plot(np.zeros((POINTS, 3)), PATH, "trace")
    plot += plain_surface(ball_surface(0.025, 16), INK, "fixed point")
    plot += line_plot(np.array([[0.0, 0.0, -1.3], [0.0, 0.0, 1.3]]), GREY, "vertical")
    plot += plain_surface(revolve(*ARROW, around=16), PATH, "momentum")
    if any(isinstance(effect, GravityGradient) for effect in effects):
        plot += plain_surface(revolve(*ARROW, around=16), PULL, "radius")  # the page turns it
    for name, direction in _pulls(effects):
        arrow = revolve(*ARROW, around=16)
        corners = 0.5 * arrow.corners @ _along(direction).T + np.array([1.15, 0.0, 0.6])
        plot += plain_surface(arrow._replace(corners=corners), PULL, name)
    return plot


def _pulls(effects: Iterable[Effect]) -> Iterable[tuple[str, Floats]]:
    """Yield (name, direction) of gravity and of uniform fields."""
    for effect in effects:
        if isinstance(effect, Gravity):
            yield "gravity", np.array([0.0, 0.0, -1.0])
        elif isinstance(effect, UniformField) and is_shared(effect.field):
            field = np.array(effect.field)
            yield "field", field / np.linalg.norm(field)


def _along(direction: Floats) -> Floats:
    """Return a rotation (3, 3) that takes axis 3 to a direction (3,)."""
    across = np.eye(3)[int(np.argmin(np.abs(direction)))]
    one = np.cross(across, direction)
    one /= np.linalg.norm(one)
    return np.stack([one, np.cross(direction, one), direction], -1)


def sphere_plot(moments: Sequence[Floats], start: Floats) -> Any:
    """Return the momentum sphere in body axes, with polhodes and separatrices of several bodies.
    The page shows the curves of one body and fills the path of a member.

    start : a direction (3,) in the octant of the viewer
    """
    plot = empty(np.copysign((2.3, 1.6, 1.4), start))
    globe = ball_surface(0.995)
    plot += k3d.mesh(
        globe.corners.astype(np.float32),
        globe.faces.astype(np.uint32),
        colors=np.full(len(globe.corners), 0xE8E8E8, dtype=np.uint32),
        flat_shading=False,
        name="globe",
    )
    for axis in range(3):
        plot += line_plot(np.outer([-1.25, 1.25], np.eye(3)[axis]), AXES[axis], f"axis{axis + 1}")
    plot += line_plot(np.zeros((POINTS, 3)), PATH, "path")
    for k, body in enumerate(moments):
        curves, separatrices = family(body)
        for curve in curves:
            plot += line_plot(curve, GREY, f"{k}/polhode")
        for curve in separatrices:
            plot += line_plot(curve, INK, f"{k}/separatrix")
    return plot
