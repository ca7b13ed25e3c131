"""The draws of a posterior: variables of the Dataset of a fit, lines of text, groups of ArviZ."""

from collections.abc import Callable, Sequence

import numpy as np
import xarray as xr

from rigidmc.files.outputs import Path, write_bytes
from rigidmc.results.labels import units_text
from rigidmc.studies.fit.posterior import SAMPLERS, Density, modes_of, package
from rigidmc.studies.fit.prior import Prior
from rigidmc.studies.fit.problem import FitProblem
from rigidmc.studies.fit.streams import Array
from rigidmc.studies.fit.uncertainty import ModelError
from rigidmc.studies.framework.variables import StudyVariable, make_dataset

AGREE, ENOUGH = 1.01, 400  # R-hat and effective draws: Vehtari et al., Bayesian Anal. 16 (2021) 667
DIVERGING = 0.01  # most, share of draws
DRAWS = (
    StudyVariable("drawn", "chain draw quantity", "", "draw of the posterior", "if it is asked"),
    StudyVariable("lp", "chain draw", "1", "logarithm of the density of a draw"),
    StudyVariable("diverging", "chain draw", "1", "1 for a trajectory that leaves its energy"),
    StudyVariable("acceptance", "chain", "1", "share of accepted moves"),
    StudyVariable("log_likelihood", "chain draw toss", "1", "logarithm of the density of a record"),
    StudyVariable("r_hat", "quantity", "1", "disagreement of the chains, 1 for none"),
    StudyVariable("effective", "quantity", "1", "effective number of draws, of body or tails"),
    StudyVariable("answer_share", "answer", "1", "share of the draws near an answer"),
)


def draw(
    problem: FitProblem, error: ModelError, answers: Sequence[Array], prior: Prior, sampler: str,
    chains: int, draws: int, seed: int, units: Sequence[str],
) -> xr.Dataset:  # fmt: skip
    """Return the draws of a posterior. answers : coordinates;  units : of the parameters"""
    density, given = Density(problem, error, prior), int(prior.ln_sum is not None)
    modes, arviz, agrees = modes_of(density, answers), package("arviz"), False
    for z, lp, *more in SAMPLERS[sampler][1](density, modes, chains, draws, seed):
        flat = z.reshape(-1, prior.size)
        walkers = prior.quantities(flat).T.reshape(-1, *lp.shape)
        groups = walkers.reshape(len(walkers), chains, -1, lp.shape[1]).swapaxes(2, 3)
        # of 64 walkers: 31 independent draws of each have an R-hat above 1.01 in 3 % of cases
        r_hat = [arviz.rhat(x.reshape(chains, -1)) for x in groups]
        counts = [np.min([arviz.ess(x), arviz.ess(x, method="tail")]) for x in walkers]
        agrees = np.max(r_hat) <= AGREE and np.min(counts) >= ENOUGH and more[0].mean() <= DIVERGING
        if agrees:
            break
    nearest = np.argmin([mode.apart(flat) for mode in modes], axis=0)
    share = np.bincount([modes[i].answer for i in nearest], minlength=len(answers)) / len(flat)
    of_records = density.of_records(flat).reshape(*lp.shape, -1)
    values = np.moveaxis(walkers, 0, 2), lp, *more, of_records, r_hat, counts, share
    unit = dict(zip(prior.parameters.names, units, strict=True)) | {"": "1"}
    names, like = zip(*prior.names(), strict=True)
    about = {"quantity": list(names), "quantity_unit": ("quantity", [unit[x] for x in like])}
    attrs = {"sampler": sampler, "given_size": given, "converged": int(agrees)}
    by_name = dict(zip((variable.name for variable in DRAWS), values, strict=True))
    return make_dataset(DRAWS, by_name, about, attrs)


def lines_of(study: xr.Dataset, digits: Callable[[float, float], tuple[str, str]]) -> list[str]:
    """Return what a posterior says, with central intervals of 95 %. digits : as `in_digits`"""
    worst, share = int(np.argmax(np.nan_to_num(study.r_hat, nan=np.inf))), study.answer_share.values
    text = (
        f"{study.lp.size:,} draws of {study.attrs['sampler']}, R-hat up to"
        f" {study.r_hat[worst]:.3f}, {study.effective.min():,.0f} effective or more,"
        f" {study.diverging.sum():.0f} diverging"
    )
    if np.count_nonzero(share) > 1:
        text += "".join(f", {share[i]:.1%} at answer {i + 1}" for i in np.flatnonzero(share))
    if not study.attrs["converged"]:
        few = study.quantity.values[np.argmin(study.effective.values)]
        text = f"chains disagree most about {study.quantity.values[worst]}; {text}"
        return [f"  no posterior: {text}; {few} has the fewest effective. Give more --draws"]
    lines = [f"  posterior: {text}"]
    if study.attrs["given_size"]:
        lines.append("  given the size of the scene's body, which the readings do not show:")
    for i, name in enumerate(study.quantity.values):
        if "[" not in name and not name.startswith("start."):
            ends = np.quantile(study.drawn.values[..., i], (0.025, 0.5, 0.975))
            low, middle, high = (digits(x, 0.25 * (ends[2] - ends[0]))[0] for x in ends)
            unit = units_text(str(study.quantity_unit.values[i]))
            lines.append(f"  {name}  {middle} ({low} to {high}) {unit}".rstrip())
    return lines


def groups_of(study: xr.Dataset) -> xr.DataTree:
    """Return the draws as groups of ArviZ; chains that disagree are `warmup_posterior`."""
    drawn, units = xr.Dataset(), study.quantity_unit.values
    for i, name in enumerate(study.quantity.values):
        about = {"units": str(units[i]), "given_size": study.attrs["given_size"]}
        part = ("chain", "draw"), study.drawn.values[..., i], about
        drawn[str(name).replace("/", " over ")] = part  # netCDF has no names with a slash
    groups = {
        "posterior" if study.attrs["converged"] else "warmup_posterior": drawn,
        "sample_stats": study[["lp"]].assign(diverging=study.diverging.astype(bool)),
        "log_likelihood": study[["log_likelihood"]],
        "observed_data": study[["data", "noise"]],
    }
    return xr.DataTree.from_dict(groups)


def save_groups(study: xr.Dataset, path: Path, force: bool) -> bool:
    """Write the groups of ArviZ, if there is a posterior."""
    if "drawn" in study:
        write_bytes(path, bytes(groups_of(study).to_netcdf(engine="netcdf4")), force)
    return "drawn" in study
