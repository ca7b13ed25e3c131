"""What tests ask of a scene before its first step."""

from rigidmc.planning import closed_form as forms
from rigidmc.planning.initial import block_rows, initial_block, make_sampler
from rigidmc.planning.monitors import make_monitors
from rigidmc.planning.notes import scene_notes, step_notes
from rigidmc.runs.assemble import make_program
from rigidmc.runs.prepare import prepare_scene


def plan_of(scene):
    """The Plan of a scene."""
    return prepare_scene(scene).plan


def program_of(scene, device="cpu"):
    """The Program of a scene for a device, uncompiled."""
    return make_program(plan_of(scene), device, compiled=False)


def starts(scene, first, count, attitude):
    """(rows, what they were made from) of members of a scene at their start."""
    known = make_sampler(scene.model, scene.run), first, count, attitude
    return initial_block(scene.model, *known, block_rows(scene.effects, "work" in scene.run.save))


def closed_form(scene, members=None, first=None):
    """The Case of members of a scene."""
    first = scene.run.first if first is None else first
    sampler = make_sampler(scene.model, scene.run)
    return forms.closed_form(scene.model, sampler, first, members or scene.run.members)


def monitors_of(scene):
    """The Monitors of a scene."""
    return make_monitors(scene.model, scene.recording, scene.run.seed)


def carries_attitude(scene):
    """Whether a run of a scene follows the attitude."""
    return monitors_of(scene).has_attitude


def notes_of(scene, plan=None):
    """The notes on a scene, with a plan of it that is known already."""
    plan = plan_of(scene) if plan is None else plan
    return (*step_notes(scene.run, plan), *scene_notes(scene.model, scene.run, plan))
