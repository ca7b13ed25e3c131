"""Members that come in families, by a design of `rigidmc.scene.points`."""

from collections.abc import Sequence
from typing import Any, cast

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from rigidmc.effects import labelled
from rigidmc.effects.protocol import is_random
from rigidmc.errors import OptionError, SceneError
from rigidmc.observables import OBSERVABLES
from rigidmc.planning.stage import source
from rigidmc.runs.capacity import refuse_count
from rigidmc.scene.amounts import counted
from rigidmc.scene.points import Design
from rigidmc.scene.scene import Scene, scene_of
from rigidmc.storage.schema import member_variables
from rigidmc.studies.measures import Variables, observing

Array = NDArray[np.float64]
KEPT = 64  # bytes of a member that a study keeps at least: a few numbers, and copies of them
Asked = tuple[Scene, tuple[str, ...], Variables]  # scene, texts, variables of its members
_ANGLES = {"phi": 0, "theta": 1, "psi": 2}


def size(scene: Scene) -> int:
    """How many members a family of a scene has."""
    return cast(Design, source(scene)).size


def made(
    scene: Scene, of: str | Sequence[str], points: str, families: int, **settings: Any
) -> Asked:
    """What measures ask of a scene with so many families, all of them drawn by a design.

    points : the name of the design;  settings : of the run
    """
    texts = (of,) if isinstance(of, str) else tuple(of)
    scene = observing(scene.with_run(**settings, points=points), texts)
    save = tuple(name for name in scene.run.save if name not in OBSERVABLES)
    many = counted(families, "families")
    count = many * size(scene)
    refuse_count(many, "families", KEPT * size(scene), "take fewer families")
    scene = scene.with_run(save=save, members=count, first=0)
    return scene, texts, member_variables(scene, False)


def stored(
    result: xr.Dataset, of: str | Sequence[str], points: str, study: str, allow_code: bool
) -> Asked:
    """What measures ask of a result; OptionError unless it is of members of a design.

    points : the name of the design;  study : what it is for
    """
    scene = scene_of(result, allow_code=allow_code)
    if scene.run.points != points:
        rule = f'a study of {study} needs members drawn with [run] points = "{points}"'
        raise OptionError("run", "points", scene.run.points, rule)
    texts = (of,) if isinstance(of, str) else tuple(of)
    return scene, texts, result.data_vars


def refuse_noise(scene: Scene) -> None:
    """SceneError for random effects, which take neighbours anywhere."""
    for label, effect in labelled(scene.effects):
        if is_random(effect):
            rule = "noise takes neighbours anywhere: this is a study of scenes without"
            raise SceneError("effects", label, None, rule)


def started(part: xr.Dataset, name: str) -> tuple[Array, str]:
    """(a number of the start of members (n,), its units); nan for a law of several numbers."""
    table, first, *rest = name.split(".")
    key = first if table == "body" else f"start_{first}"
    if table == "effects":
        key = f"{first}_{rest.pop(0)}"
    variable = part.get("start_euler" if key == "start_attitude" else key)
    if variable is None or (variable.ndim > 1) != bool(rest):
        return np.full(part.sizes["member"], np.nan), "1"
    values = variable.transpose(..., "member").values.reshape(-1, part.sizes["member"])
    row = _ANGLES.get(rest[0]) if rest else 0
    return values[int(rest[0]) - 1 if row is None else row], variable.attrs["units"]
