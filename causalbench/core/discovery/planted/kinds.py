"""The kinds of planted worlds. A kind is a function of a generator, which draws which actions cause what."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from causalbench.core.discovery.planted.spec import N_STATE, Part, PlantedTerm, PlantedWorld
from causalbench.errors import UnknownNameError

GRADED = (0.003, 0.01, 0.03, 0.06, 0.1, 0.2, 0.4, 0.9)
"""Shares of variance of the graded effects."""
NOISE_LEVELS = (0.01, 0.03, 0.1, 0.3, 0.9)
"""Shares of variance that restoring draws anew."""
Kind = Callable[[np.random.Generator], dict[str, Any]]


def _draw(rng: np.random.Generator, n: int, size: int) -> tuple[int, ...]:
    """Numbers of `size` of `n` actions."""
    return tuple(int(k) for k in rng.choice(n, size, replace=False))


def _single(parts: Sequence[Part], **more: Any) -> PlantedTerm:
    return PlantedTerm(tuple(parts), **more)


def _one_form(form: str, share: float, n_actions: int = 5, n_terms: int = 4, state: int = 0) -> Kind:
    """Every second term has one effect of that form and share; the others are noise."""

    def kind(rng: np.random.Generator) -> dict[str, Any]:
        size = 2 if form in ("product", "sign_product") else 1
        terms = [
            _single([Part(form, _draw(rng, n_actions, size), share, state)] if j % 2 == 0 else [])
            for j in range(n_terms)
        ]
        return {"n_actions": n_actions, "stages": (tuple(terms),)}

    return kind


def _graded(rng: np.random.Generator) -> dict[str, Any]:
    actions = rng.permutation(5)[:4]
    terms = [_single([Part("linear", (int(actions[j % 4]),), share)]) for j, share in enumerate(GRADED)]
    return {"n_actions": 5, "stages": (tuple(terms),)}


def _triple(rng: np.random.Generator) -> dict[str, Any]:
    return {"n_actions": 5, "stages": ((_single([Part("sign_product", _draw(rng, 5, 3), 0.3)]), PlantedTerm()),)}


def _many(shares: Sequence[float], n_actions: int) -> Kind:
    """Two terms with a linear effect of each of these shares, and one that is noise."""

    def kind(rng: np.random.Generator) -> dict[str, Any]:
        terms = []
        for _ in range(2):
            actions = _draw(rng, n_actions, len(shares))
            terms.append(_single([Part("linear", (k,), share) for k, share in zip(actions, shares, strict=True)]))
        return {"n_actions": n_actions, "stages": ((*terms, PlantedTerm()),)}

    return kind


def _noisy(noise: str) -> Kind:
    def kind(rng: np.random.Generator) -> dict[str, Any]:
        terms = [_single([Part("linear", _draw(rng, 5, 1), share)], noise=noise) for share in (0.1, 0.3)]
        return {"n_actions": 5, "stages": ((*terms, PlantedTerm(noise=noise)),)}  # type: ignore[arg-type]

    return kind


def _shaped(shape: str, share: float) -> Kind:
    def kind(rng: np.random.Generator) -> dict[str, Any]:
        terms = [_single([Part("linear", _draw(rng, 5, 1), share)], shape=shape) for _ in range(2)]
        return {"n_actions": 5, "stages": ((*terms, PlantedTerm(shape=shape)),)}  # type: ignore[arg-type]

    return kind


def _delayed(rng: np.random.Generator) -> dict[str, Any]:
    now, before = _draw(rng, 4, 2)
    terms = _single([Part("linear", (before,), 0.9, lag=1)]), _single([Part("linear", (now,), 0.3)])
    return {"n_actions": 4, "stages": (terms,)}


def _confounded(rng: np.random.Generator) -> dict[str, Any]:
    driver, cause = _draw(rng, 4, 2)
    terms = _single([Part("linear", (cause,), 0.3)], state_share=0.5, state=1), PlantedTerm(state_share=0.7, state=1)
    return {"n_actions": 4, "stages": (terms,), "driven": ((1, driver, 0.8),)}


def _copies(rng: np.random.Generator) -> dict[str, Any]:
    """A constant term, two equal ones, and two whose noise is the same."""
    one, two = _draw(rng, 5, 2)
    first = _single([Part("linear", (one,), 0.2)], noise_number=0)
    second = _single([Part("linear", (two,), 0.2)], noise_number=0)
    return {"n_actions": 5, "stages": ((first, first, second, PlantedTerm(offset=-0.5)),), "constant": (3,)}


def _scaled(rng: np.random.Generator) -> dict[str, Any]:
    """Equal but for scale and offset."""
    part = Part("linear", _draw(rng, 5, 1), 0.2)
    units = ((1.0, 0.0), (1e-7, 0.0), (1e4, 0.0), (1e-2, 10.0), (-1.0, 0.0))
    return {"n_actions": 5, "stages": (tuple(_single([part], scale=s, offset=o) for s, o in units),)}


def _left(limits: Sequence[float], n_stages: int) -> Kind:
    def kind(rng: np.random.Generator) -> dict[str, Any]:
        stages = tuple((_single([Part("linear", _draw(rng, 4, 1), 0.3)]), PlantedTerm()) for _ in range(n_stages))
        return {"n_actions": 4, "stages": stages, "leaves": tuple((_draw(rng, 4, 1)[0], x) for x in limits)}

    return kind


def _null(**more: Any) -> Kind:
    return lambda rng: {"n_actions": 5, "stages": (tuple(PlantedTerm(**more) for _ in range(4)),)}


def _random_graph(n_actions: int, n_terms: int, density: float) -> Kind:
    """Each term has some linear, product and threshold effects that share seven tenths of its variance."""

    def kind(rng: np.random.Generator) -> dict[str, Any]:
        terms = []
        for _ in range(n_terms):
            causes = np.flatnonzero(rng.random(n_actions) < density)
            shares = 0.7 * rng.dirichlet(np.full(len(causes), 3.0)) if len(causes) else np.zeros(0)
            forms = rng.choice(["linear", "threshold", "saturating", "absolute"], len(causes))
            parts = [Part(str(f), (int(k),), float(s)) for f, k, s in zip(forms, causes, shares, strict=True)]
            terms.append(_single(parts, state_share=0.1))
        return {"n_actions": n_actions, "stages": (tuple(terms),)}

    return kind


def _distracted(times: int) -> Kind:
    """Three actions with one term each, and `times` as many actions and terms that have nothing to do with them."""

    def kind(rng: np.random.Generator) -> dict[str, Any]:
        n = 3 * (1 + times)
        actions, places = _draw(rng, n, 3), _draw(rng, n, 3)
        terms = [PlantedTerm(state_share=0.3) for _ in range(n)]
        for k, j in zip(actions, places, strict=True):
            terms[j] = _single([Part("linear", (k,), 0.3)], state_share=0.3)
        return {"n_actions": n, "stages": (tuple(terms),)}

    return kind


def _with(kind: Kind, **more: Any) -> Kind:
    return lambda rng: kind(rng) | more


KINDS: Mapping[str, Kind] = {
    "graded": _graded,
    "absolute": _one_form("absolute", 0.05),
    "threshold": _one_form("threshold", 0.2),
    "saturating": _one_form("saturating", 0.2),
    "even": _one_form("even", 0.2),
    "cosine": _one_form("cosine", 0.2),
    "interaction_of_2": _one_form("sign_product", 0.3),
    "interaction_of_3": _triple,
    "local": _one_form("local", 0.2),
    "opposite_sign": _one_form("sign_of_state", 0.3),
    "hidden_sign": _one_form("sign_of_state", 0.3, state=N_STATE - 1),
    "variance_only": _one_form("variance", 0.3),
    "heavy_tails": _noisy("student_t3"),
    "lognormal": _noisy("lognormal"),
    "binary": _shaped("binary", 0.4),
    "sparse": _shaped("sparse", 0.6),
    "delayed": _delayed,
    "confounded": _confounded,
    "copies": _copies,
    "units": _scaled,
    "equal_causes": _many((0.1,) * 7, 7),
    "many_causes": _many((0.3, 0.15, 0.1, 0.06), 7),
    "dominant": _many((0.75, 0.07, 0.07), 5),
    "left_at_once": _left((-2.0,), 1),
    "three_stages": _left((0.6, 0.6, 0.6), 3),
    "null": _null(),
    "null_of_the_state": _null(state_share=1.0),
    "null_heavy": _null(noise="student_t3"),
    "causal_moma": _random_graph(8, 11, 0.25),
    "random_graph": _random_graph(6, 5, 0.4),
    **{f"distractors_{times}": _distracted(times) for times in (0, 3, 10)},
    **{f"restore_noise_{level:g}": _with(_graded, restore_noise=level) for level in NOISE_LEVELS},
    **{f"null_restore_noise_{level:g}": _with(_null(), restore_noise=level) for level in NOISE_LEVELS},
    "variance_restore_noise": _with(_one_form("variance", 0.4), restore_noise=0.2),
    "no_snapshots": _with(_graded, restores=False),
    "null_no_snapshots": _with(_null(), restores=False),
}
"""By name: what is special about the worlds of the kind."""


def planted(kind: str, seed: int = 0) -> PlantedWorld:
    """The planted world of `kind` and `seed`, always the same. Raises `UnknownNameError` for a kind that is none."""
    if kind not in KINDS:
        raise UnknownNameError("kind of planted world", kind, KINDS)
    # The name, not its place, seeds a kind, so that a new kind changes none of the others.
    return PlantedWorld(kind=kind, seed=seed, **KINDS[kind](np.random.default_rng([seed, *kind.encode()])))


def catalogue(seed: int = 0) -> tuple[PlantedWorld, ...]:
    """One world of every kind."""
    return tuple(planted(kind, seed) for kind in KINDS)
