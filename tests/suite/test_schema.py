"""The suite file: what is read from it, and what each mistake says."""

from __future__ import annotations

from pathlib import Path

import pytest

from causalbench.errors import SuiteError
from causalbench.suite.schema import DISCOVERY, LEARNER, load_suite

GOOD = """\
schema: 1
name: demo
task: pure_manipulation
backends: [kinematic]
methods: [cmSAC, mSAC]
tiers:
  quick:
    seeds: 1
    env_steps: 20_000
evaluation:
  every: 2_000
discovery:
  preset: quick
learner:
  preset: quick
  learning_rate: 1e-3
  PPO: {n_epochs: 4, log_std_init: -1}
per_method:
  mSAC:
    learner: {gamma: 0.9}
"""


def write(folder: Path, text: str) -> Path:
    path = folder / "demo.yaml"
    path.write_text(text)
    return path


def test_a_good_file_keeps_what_it_says_in_the_types_of_core(tmp_path: Path) -> None:
    suite = load_suite(write(tmp_path, GOOD)).suite
    assert suite.tiers["quick"].env_steps == 20_000
    ppo = {"n_epochs": 4, "log_std_init": -1.0}
    assert suite.learner == {"preset": "quick", "learning_rate": 0.001, "PPO": ppo}  # YAML reads 1e-3 as text
    assert suite.per_method["mSAC"].learner == {"gamma": 0.9}


def test_the_shipped_suites_are_valid() -> None:
    suites = sorted((Path(__file__).parents[2] / "suites").glob("*.yaml"))
    assert [load_suite(path).suite.name for path in suites] == [path.stem for path in suites]


def test_the_suite_of_the_page_for_backend_authors_is_valid(tmp_path: Path) -> None:
    page = (Path(__file__).parents[2] / "docs" / "plugins.md").read_text()
    text = page.partition("```yaml\n")[2].partition("```")[0].replace("my_sim", "kinematic")
    suite = load_suite(write(tmp_path, text)).suite
    assert suite.backends == ("kinematic",)
    assert suite.tiers["smoke"].env_steps == 600


@pytest.mark.parametrize(
    ("old", "new", "line", "message"),
    [
        ("learning_rate:", "learning_rte:", 16, "learner.learning_rte: unknown key. Did you mean 'learning_rate'?"),
        ("evaluation:", "evalution:", 10, "evalution: unknown key. Did you mean 'evaluation'?"),
        ("    seeds: 1", "    sedes: 1", 8, "tiers.quick.sedes: unknown key. Did you mean 'seeds'? Known: learner,"),
        ("n_epochs:", "n_epoch:", 17, "learner.PPO.n_epoch: unknown key. Did you mean 'n_epochs'? Known: preset, n_"),
        ("n_epochs: 4, log_std_init: -1", "preset: papr", 17,
         "learner.PPO.preset: should be 'quick' or 'paper', got 'papr'. Did you mean 'paper'?"),
        ("gamma:", "gama:", 20, "per_method.mSAC.learner.gama: unknown key. Did you mean 'gamma'?"),
        ("  mSAC:", "  mSAK:", 19, "per_method.mSAK: not one of this suite's: cmSAC, mSAC. Did you mean 'mSAC'?"),
        ("  quick:", "  quik:", 7, "tiers.quik: should be 'smoke', 'quick' or 'full', got 'quik'. Did you mean"),
        ("discovery:\n  preset: quick", "discovery:\n  preset: papr", 13,
         "discovery.preset: should be 'quick', 'paper' or 'paper_large', got 'papr'. Did you mean 'paper'?"),
        ("discovery:\n  preset: quick", "discovery:\n  kl: {epsilon_vc: 1}", 13,
         "discovery.kl.epsilon_vc: unknown key. Did you mean 'epsilon_cv'? Known: batch_size,"),
        ("discovery:\n  preset: quick", "discovery:\n  permutation: {level: 1.5}", 13,
         "discovery.permutation.level: should be less than or equal to 1, got 1.5"),
        ("discovery:\n  preset: quick", "discovery:\n  max_epochs: 3", 13,
         "discovery.max_epochs: unknown key."),
        ("20_000", "lots", 9,
         "tiers.quick.env_steps: should be a valid integer, unable to parse string as an integer, got 'lots'"),
        ("every: 2_000", "every: 0", 11, "evaluation.every: should be greater than 0, got 0"),
        ("task: pure_manipulation\n", "", 1, "task: this key is missing"),
        ("schema: 1", "schema: 2", 1, "schema: should be 1, got 2."),
        ("[cmSAC, mSAC]", "[cmSAC, mSAC, cmSAC]", 5, "methods.2: 'cmSAC' is listed twice"),
        ("task: pure", "name: other\ntask: pure", 3, "name: this key is given twice"),
        ("[kinematic]", "[kinematic", 5, "not valid YAML: expected ',' or ']', but got ':'"),
    ],
)  # fmt: skip
def test_a_mistake_names_file_line_key_and_the_nearest_name(
    tmp_path: Path, old: str, new: str, line: int, message: str
) -> None:
    assert GOOD.count(old) == 1, "the replacement must change one place"
    path = write(tmp_path, GOOD.replace(old, new))
    with pytest.raises(SuiteError) as caught:
        load_suite(path)
    assert str(caught.value).startswith(f"{path}:{line}: {message}")


def test_a_missing_file_and_an_empty_one_say_what_is_expected(tmp_path: Path) -> None:
    with pytest.raises(SuiteError, match=r"nowhere.yaml: cannot be read .*expected a suite file"):
        load_suite(tmp_path / "nowhere.yaml")
    with pytest.raises(SuiteError, match=r"demo.yaml:1: the file: expected `key: value` lines"):
        load_suite(write(tmp_path, ""))


def test_settings_start_from_the_last_preset_and_the_last_value_wins() -> None:
    patches = [{"preset": "quick", "gamma": 0.5, "tau": 0.1}, {"preset": "paper", "gamma": 0.7}]
    settings = LEARNER.resolve("SAC", patches)
    assert (settings.net_arch, settings.gamma, settings.tau) == ((512, 512), 0.7, 0.1)
    assert DISCOVERY.resolve([]).training_count == 3_000


def test_a_learner_key_goes_to_every_learner_that_has_it_and_a_section_to_one() -> None:
    patches = [{"gamma": 0.5, "tau": 0.1, "SAC": {"gamma": 0.6}}, {"batch_size": 8, "PPO": {"preset": "paper"}}]
    sac, ppo = (LEARNER.resolve(name, patches) for name in ("SAC", "PPO"))
    assert (sac.gamma, sac.tau, sac.batch_size, sac.net_arch) == (0.6, 0.1, 8, (64, 64))
    assert (ppo.gamma, ppo.n_steps, ppo.batch_size) == (0.5, 10_000, 8)
