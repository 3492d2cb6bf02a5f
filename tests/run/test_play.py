"""Films of trained policies."""

import shutil
import subprocess
from itertools import groupby
from pathlib import Path

import imageio_ffmpeg
import numpy as np
import pytest

from causalbench.core.kinematic import make
from causalbench.core.learners.policy import load_policy
from causalbench.core.learners.settings import FIRST_START
from causalbench.core.staged.env import StageTaskEnv
from causalbench.core.staged.scene_worlds import SceneWorlds
from causalbench.core.tasks.pure_manipulation import TASK
from causalbench.errors import UserError
from causalbench.run.play import STILL, film_episode, play
from causalbench.store.films import read_film
from causalbench.store.run_folder import RunFolder


@pytest.fixture
def run(finished_run: Path, tmp_path: Path) -> RunFolder:
    shutil.copytree(finished_run, tmp_path / "run")
    return RunFolder(tmp_path / "run")


def test_a_policy_is_filmed_as_long_as_its_episode_lasts(run: RunFolder) -> None:
    (path,) = play(run, ["method=cmSAC"], 1)
    (folder,) = run.path.glob("cells/*-cmSAC-*")
    assert path == run.path / "videos" / f"{folder.name}.mp4"
    assert {found.name for found in path.parent.iterdir()} == {path.name, f"{folder.name}.json"}
    policy, env = load_policy(folder / "policy"), StageTaskEnv(SceneWorlds(TASK, make()))
    obs, _ = env.reset(seed=FIRST_START, options={"stage": 1})
    steps, over = 0, False
    while not over:
        obs, _, terminated, truncated, _ = env.step(policy.predict(obs)[0])
        steps, over = steps + 1, terminated or truncated
    command = [imageio_ffmpeg.get_ffmpeg_exe(), "-i", str(path), "-f", "rawvideo", "-pix_fmt", "rgb24", "-"]
    done = subprocess.run(command, capture_output=True, check=True)
    assert b"640x480" in done.stderr
    assert b" 10 fps" in done.stderr
    frames = np.frombuffer(done.stdout, np.uint8).reshape(-1, 480, 640, 3)
    assert len(frames) == steps + 1 + round(10 * STILL)
    film = read_film(path)
    assert (film.fps, film.n_stages) == (10, 4)
    assert sum(n for _, n in film.runs) == len(frames)
    assert np.abs(frames[0].astype(int) - frames[steps]).mean() > 1  # it moved


class Expert:
    """The scripted expert as a policy."""

    def __init__(self, env: StageTaskEnv) -> None:
        self.env = env

    def predict(self, obs):
        return self.env.worlds.expert(), None


def test_every_frame_is_the_scene_with_its_stage_written_above(monkeypatch: pytest.MonkeyPatch) -> None:
    env, texts = StageTaskEnv(SceneWorlds(TASK, make())), []
    from causalbench.run import play as module

    real = module._captioned
    monkeypatch.setattr(module, "_captioned", lambda env, text: texts.append(text) or real(env, text))
    shots = list(film_episode(Expert(env), env, 0, "expert"))
    frames = [shot.picture for shot in shots]
    assert [stage for stage, _ in groupby(shot.stage for shot in shots)] == [1, 2, 3, 4, 5]
    assert texts[0] == "expert: step 0, stage 1 of 4"
    assert texts[-1].endswith("stage 4 of 4, SUCCESS")
    assert len(frames) == len(texts) + 10
    below = frames[len(texts) - 1][module.CAPTION + 1 :]
    assert np.array_equal(below, env.worlds.scene.render(640, 480)[module.CAPTION + 1 :])
    assert frames[0][: module.CAPTION].max() == 255


def test_nothing_to_film_is_said(run: RunFolder, tmp_path: Path) -> None:
    with pytest.raises(UserError, match="no finished policy here"):
        list(play(run, ["seed=7"], 1))
    with pytest.raises(UserError, match="no finished policy here"):
        list(play(RunFolder(tmp_path / "empty"), [], 1))
