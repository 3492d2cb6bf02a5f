"""Films of trained policies: whole task episodes from stage 1, on the starts that evaluations use."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from causalbench.atomic import replacing
from causalbench.core.learners.registry import Policy
from causalbench.core.staged.env import StageTaskEnv
from causalbench.errors import UserError
from causalbench.run.policies import finished, trained
from causalbench.store.cells import StoredCell
from causalbench.store.claim import own_folder
from causalbench.store.episodes import run_lengths
from causalbench.store.films import VIDEOS, Film, write_film
from causalbench.store.run_folder import RunFolder

WIDTH, HEIGHT = 640, 480  # pixels; both are multiples of 16, as the codec wants them
CAPTION = 24  # pixels
STILL = 1.0  # s for which the end of an episode stays in view

Frame = NDArray[np.uint8]


class Shot(NamedTuple):
    """A picture (480, 640, 3), and the stage that it shows; n_stages + 1 once the episode succeeded."""

    picture: Frame
    stage: int


def play(run: RunFolder, only: Sequence[str], episodes: int) -> Iterator[Path]:
    """Film `episodes` of every finished policy that `only` keeps; the files, each once it is whole.

    They are `videos/<cell id>.mp4` in the run's folder, at the speed of the world, each with its stages in a .json
    beside it. Raises `UserError` when there is nothing to film or nothing to film it with.
    """
    cells = finished(run, only)
    videos = own_folder(run.path / VIDEOS)
    for cell in cells:
        yield _film(cell, videos / f"{cell.id}.mp4", episodes)


def _film(cell: StoredCell, path: Path, episodes: int) -> Path:
    try:
        import imageio.v2 as imageio
        import imageio_ffmpeg  # noqa: F401 - imageio's way to mp4
    except ImportError as error:
        raise UserError("videos need `pip install causalbench-robotics[video]`") from error

    title = f"{cell.method} on {cell.backend}, seed {cell.seed}"
    ready = trained(cell)
    with ready.env() as env:
        look = {"fps": env.metadata["render_fps"], "codec": "libx264", "quality": 8}
        stages = []
        with replacing(path) as temporary, imageio.get_writer(temporary, **look) as writer:
            for episode in range(episodes):
                for shot in film_episode(ready.policy, env, ready.first_start + episode, title):
                    writer.append_data(shot.picture)  # type: ignore[attr-defined]
                    stages.append(shot.stage)
        write_film(path, Film(env.metadata["render_fps"], env.task.n_stages, run_lengths(stages)))
    return path


def film_episode(policy: Policy, env: StageTaskEnv, seed: int, title: str) -> Iterator[Shot]:
    """The pictures of one deterministic episode, with the stage and what happened written on them."""
    obs, info = env.reset(seed=seed, options={"stage": 1})
    stage, over, step = info["stage"], False, 0
    shot = Shot(_captioned(env, f"{title}: step 0, stage {stage} of {env.task.n_stages}"), stage)
    yield shot
    while not over:
        action, _ = policy.predict(obs)
        obs, _, terminated, truncated, info = env.step(action)
        over, step = terminated or truncated, step + 1
        what = " (fell back)" if info["reversal"] else ""
        ending = ", the end" if terminated else ", out of time" if truncated else ""
        verdict = ", SUCCESS" if info["is_success"] else ending
        text = f"{title}: step {step}, stage {info['next_stage']} of {env.task.n_stages}{what}{verdict}"
        stage = env.task.n_stages + 1 if info["is_success"] else info["next_stage"]
        shot = Shot(_captioned(env, text), stage)
        yield shot
    for _ in range(round(STILL * env.metadata["render_fps"])):
        yield shot


def _captioned(env: StageTaskEnv, text: str) -> Frame:
    from PIL import Image, ImageDraw, ImageFont

    picture = Image.fromarray(env.worlds.render(WIDTH, HEIGHT))
    draw = ImageDraw.Draw(picture)
    draw.rectangle((0, 0, WIDTH, CAPTION), fill=(0, 0, 0))
    draw.text((6, 4), text, fill=(255, 255, 255), font=ImageFont.load_default(14))
    return np.array(picture)
