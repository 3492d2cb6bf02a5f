"""The suite file: what is read from it, and what each mistake says."""

from __future__ import annotations

import dataclasses
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import pytest
from annotated_types import Gt

from causalbench.core.learners.methods import Method
from causalbench.core.learners.registry import Learner
from causalbench.errors import SuiteError
from causalbench.plugins.manager import Plugins, load_plugins
from causalbench.suite.schema import SuiteFile, load_suite
from causalbench.suite.sections import Sections

GOOD = """\
schema: 1
name: demo
task: pure_manipulation
backends: [kinematic]
methods: [cmSAC, mSAC, mPPO]
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


@pytest.fixture(scope="module")
def plugins() -> Plugins:
    return load_plugins()


def load(folder: Path, text: str, plugins: Plugins) -> SuiteFile:
    path = folder / "demo.yaml"
    path.write_text(text)
    return load_suite(path, plugins)


def test_a_good_file_becomes_records_of_core(tmp_path: Path, plugins: Plugins) -> None:
    file = load(tmp_path, GOOD, plugins)
    suite, learner = file.suite, file.sections.learner
    assert suite.tiers["quick"].env_steps == 20_000
    ppo = learner.resolve("PPO", [suite.learner])
    assert (ppo.learning_rate, ppo.n_epochs, ppo.log_std_init) == (0.001, 4, -1.0)
    assert type(ppo.log_std_init) is float
    sac = learner.resolve("SAC", [suite.learner, suite.per_method["mSAC"].learner])
    assert sac == plugins.learners["SAC"].settings(gamma=0.9)


def test_the_shipped_suites_are_valid(plugins: Plugins) -> None:
    suites = sorted((Path(__file__).parents[2] / "suites").glob("*.yaml"))
    assert [load_suite(path, plugins).suite.name for path in suites] == [path.stem for path in suites]


def test_the_suite_of_the_page_for_backend_authors_is_valid(tmp_path: Path, plugins: Plugins) -> None:
    page = (Path(__file__).parents[2] / "docs" / "plugins.md").read_text()
    text = page.partition("```yaml\n")[2].partition("```")[0].replace("my_sim", "kinematic")
    suite = load(tmp_path, text, plugins).suite
    assert suite.backends == ("kinematic",)
    assert suite.tiers["smoke"].env_steps == 600


def test_the_suites_of_the_page_on_suites_are_valid(tmp_path: Path, plugins: Plugins) -> None:
    page = (Path(__file__).parents[2] / "docs" / "how-to" / "suite.md").read_text()
    texts = [part.partition("```")[0] for part in page.split("```yaml\n")[1:]]
    assert [load(tmp_path, text, plugins).suite.name for text in texts] == ["rates", "sample_sizes", "carried"]


def refused(folder: Path, text: str, plugins: Plugins) -> str:
    with pytest.raises(SuiteError) as caught:
        load(folder, text, plugins)
    return str(caught.value).removeprefix(f"{folder}/demo.yaml:")


@pytest.mark.parametrize(
    ("old", "new", "line", "message"),
    [
        ("learning_rate:", "learning_rte:", 16, "learner.learning_rte: unknown key. Did you mean 'learning_rate'?"),
        ("evaluation:", "evalution:", 10, "evalution: unknown key. Did you mean 'evaluation'?"),
        ("    seeds: 1", "    sedes: 1", 8, "tiers.quick.sedes: unknown key. Did you mean 'seeds'? Known: learner,"),
        ("every:", "evry:", 11, "evaluation.evry: unknown key. Did you mean 'every'? Known: every, episodes, final_"),
        ("n_epochs:", "n_epoch:", 17, "learner.PPO.n_epoch: unknown key. Did you mean 'n_epochs'? Known: preset, n_"),
        ("n_epochs: 4, log_std_init: -1", "preset: papr", 17,
         "learner.PPO.preset: should be 'quick' or 'paper', got 'papr'. Did you mean 'paper'?"),
        ("learner:\n  preset: quick", "learner:\n  preset: papr", 15,
         "learner.preset: should be 'quick' or 'paper', got 'papr'. Did you mean 'paper'?"),
        ("PPO:", "POP:", 17, "learner.POP: unknown key. Did you mean 'PPO'?"),
        ("gamma:", "gama:", 20, "per_method.mSAC.learner.gama: unknown key. Did you mean 'gamma'?"),
        ("  mSAC:", "  mSAK:", 19, "per_method.mSAK: not one of this suite's: cmSAC, mSAC, mPPO. Did you mean 'mSAC'?"),
        ("cmSAC", "cmSACK", 5, "methods.0: unknown method 'cmSACK'. Did you mean 'cmSAC'?"),
        ("discovery:\n  preset: quick", "discovery:\n  preset: papr", 13,
         "discovery.preset: should be 'quick', 'paper' or 'paper_large', got 'papr'. Did you mean 'paper'?"),
        ("discovery:\n  preset: quick", "discovery:\n  kl: {epsilon_c: 1.0}", 13,
         "discovery.kl.epsilon_c: unknown key. Did you mean 'epsilon_cv'?"),
        ("discovery:\n  preset: quick", "discovery:\n  discoverer: klm", 13,
         "discovery.discoverer: unknown discoverer 'klm'. Did you mean 'kl'?"),
        ("20_000", "lots", 9, "tiers.quick.env_steps: should be a valid integer, got 'lots'"),
        ("every: 2_000", "every: 0", 11, "evaluation.every: should be greater than 0, got 0"),
        ("discovery:\n  preset: quick", "discovery:\n  paired: {}", 13,
         "discovery.paired: settings of the discoverer 'paired', and this suite discovers with kl; leave it out"),
        ("    env_steps: 20_000", "    env_steps: 20_000\n    discovery: {discoverer: paired, cmi: {}}", 10,
         "tiers.quick.discovery.cmi: settings of the discoverer 'cmi', and this suite discovers with kl, paired"),
        ("mPPO]", "mPPO]\ngrid: {discovery.paired.max_actions: [10, 20]}", 6,
         "grid.discovery.paired.max_actions: settings of the discoverer 'paired', and this suite discovers with kl; l"),
        ("[cmSAC, mSAC, mPPO]", "[mSAC, mPPO]\ngraphs: per_seed", 6,
         "graphs: no graph is discovered for mSAC, mPPO; leave it out"),
        ("[cmSAC, mSAC, mPPO]\ntiers:\n  quick:", "[mSAC, mPPO]\ntiers:\n  quick:\n    graphs: shared", 8,
         "tiers.quick.graphs: no graph is discovered for mSAC, mPPO; leave it out"),
        ("name: demo", f"name: {'a' * 65}", 2, "name: String should have at most 64 characters, got 'aaa"),
        ("task: pure_manipulation\n", "", 1, "task: this key is missing"),
        ("    env_steps: 20_000\n", "", 7, "tiers.quick.env_steps: this key is missing"),
        ("schema: 1", "schema: 2", 1, "schema: should be 1, got 2."),
        ("mPPO]", "mPPO, cmSAC]", 5, "methods.3: 'cmSAC' is listed twice"),
        ("task: pure", "name: other\ntask: pure", 3, "name: this key is given twice"),
        ("mPPO]", "mPPO]\nhypotheses: [cmSAC > mSAK]", 6,
         "hypotheses.0: 'mSAK' is not one of this suite's: cmSAC, mSAC, mPPO. Did you mean 'mSAC'?"),
        ("mPPO]", "mPPO]\nhypotheses:\n  - cmSAC > mSAC\n  - mPPO < cmSAC", 8,
         "hypotheses.1: 'mPPO < cmSAC': expected `A > B` or `A == B within 0.1`, A and B being methods of this suite"),
        ("mPPO]", "mPPO]\nhypotheses: [cmSAC == mSAC]", 6,
         "hypotheses.0: 'cmSAC == mSAC': say which difference of the success area still counts as none: `cmSAC == mS"),
        ("mPPO]", "mPPO]\nhypotheses: [cmSAC == mSAC within 2]", 6,
         "hypotheses.0: 'cmSAC == mSAC within 2': expected a difference of success areas between 0 and 1, got '2'"),
        ("mPPO]", "mPPO]\nhypotheses: [cmSAC > mSAC within 0.1]", 6,
         "hypotheses.0: 'cmSAC > mSAC within 0.1': `within` belongs to `==`; write `cmSAC > mSAC`"),
        ("mPPO]", "mPPO]\nhypotheses: [mSAC > mSAC]", 6,
         "hypotheses.0: 'mSAC > mSAC': a method is not compared with itself"),
        ("mPPO]", "mPPO]\nhypotheses: [cmSAC > mSAC, mSAC > cmSAC]", 6,
         "hypotheses.1: 'mSAC > cmSAC': these two methods are compared in a line above"),
        ("[kinematic]", "[kinematic", 5, "not valid YAML: expected ',' or ']', but got ':'"),
    ],
)  # fmt: skip
def test_a_mistake_names_file_line_key_and_the_nearest_name(
    tmp_path: Path, plugins: Plugins, old: str, new: str, line: int, message: str
) -> None:
    assert GOOD.count(old) == 1, "the replacement must change one place"
    assert refused(tmp_path, GOOD.replace(old, new), plugins).startswith(f"{line}: {message}")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("seeds: 1", "seeds: true", "8: tiers.quick.seeds: should be a valid integer, got True"),
        ("seeds: 1", "seeds: '1'", "8: tiers.quick.seeds: should be a valid integer, got '1'"),
        ("seeds: 1", "seeds: 10_001", "8: tiers.quick.seeds: should be less than or equal to 10000"),
        ("seeds: 1", "seeds: yes", "8: tiers.quick.seeds: should be a valid integer, got 'yes'"),
        ("gamma: 0.9", "gamma: 1.01", "20: per_method.mSAC.learner.gamma: should be less than or equal to 1, got 1.01"),
        ("gamma: 0.9", "gamma: .nan", "20: per_method.mSAC.learner.gamma: should be a valid number, got '.nan'"),
        ("gamma: 0.9", "gamma: 1e999", "20: per_method.mSAC.learner.gamma: should be a finite number"),
        ("log_std_init: -1", "log_std_init: 1e999", "17: learner.PPO.log_std_init: should be a finite number"),
        ("gamma: 0.9", "net_arch: [64, 0]", "20: per_method.mSAC.learner.net_arch.1: should be greater than 0, got 0"),
        ("gamma: 0.9", "n_epochs: 3",
         "20: per_method.mSAC.learner.n_epochs: a setting of PPO and SB3-PPO methods, and mSAC is none; leave it out"),
        ("mPPO]", "PPO]\ngraphs: private", "6: graphs: should be 'per_seed' or 'shared', got 'private'"),
    ],
)  # fmt: skip
def test_values_are_read_strictly(tmp_path: Path, plugins: Plugins, old: str, new: str, message: str) -> None:
    assert refused(tmp_path, GOOD.replace(old, new), plugins).startswith(message)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a: &x 1\nb: *x\n", "2: not valid YAML: aliases are not read"),
        ("a: !!python/object/apply:os.system [ls]\n", "1: not valid YAML: tags are not read"),
        ("a: !!int x\n", "1: not valid YAML: tags are not read"),
        ("? [a]\n: 1\n", "1: not valid YAML: found unhashable key"),
        ("a: 1\n---\nb: 2\n", "2: not valid YAML: but found another document"),
        ("[" * 5_000, "1: not valid YAML: nested too deeply for a suite"),
        ("a: " + "9" * 5_000, " a whole number in it has thousands of digits"),
        ("a: \0", " not valid YAML: unacceptable character"),
        ("#" * 1_000_001, " 1000001 bytes, and a suite file has at most 1000000"),
    ],
)
def test_what_is_no_plain_small_yaml_is_a_suite_error(
    tmp_path: Path, plugins: Plugins, text: str, message: str
) -> None:
    assert refused(tmp_path, text, plugins).startswith(message)


def test_what_is_no_file_says_what_is_expected(tmp_path: Path, plugins: Plugins) -> None:
    with pytest.raises(SuiteError, match=r"nowhere.yaml: cannot be read .*expected a suite file"):
        load_suite(tmp_path / "nowhere.yaml", plugins)
    with pytest.raises(SuiteError, match=r"demo.yaml:1: the file: expected `key: value` lines"):
        load(tmp_path, "", plugins)
    os.mkfifo(tmp_path / "pipe.yaml")
    for path in (tmp_path / "pipe.yaml", tmp_path, Path("/dev/zero")):
        with pytest.raises(SuiteError, match="not a regular file; expected a suite file"):
            load_suite(path, plugins)


def test_settings_start_from_the_last_preset_and_the_last_value_wins(plugins: Plugins) -> None:
    sections = Sections.of(plugins, ["SAC"])
    patches = [{"preset": "quick", "gamma": 0.5, "tau": 0.1}, {"preset": "paper", "gamma": 0.7}]
    settings = sections.learner.resolve("SAC", patches)
    assert (settings.net_arch, settings.gamma, settings.tau) == ((512, 512), 0.7, 0.1)
    assert sections.discovery.resolve([]).training_count == 3_000


def test_a_learner_key_goes_to_every_learner_that_has_it_and_a_section_to_one(plugins: Plugins) -> None:
    section = Sections.of(plugins, ["SAC", "PPO"]).learner
    patches = [{"gamma": 0.5, "tau": 0.1, "SAC": {"gamma": 0.6}}, {"batch_size": 8, "PPO": {"preset": "paper"}}]
    sac, ppo = (section.resolve(name, patches) for name in ("SAC", "PPO"))
    assert (sac.gamma, sac.tau, sac.batch_size, sac.net_arch) == (0.6, 0.1, 8, (64, 64))
    assert (ppo.gamma, ppo.n_steps, ppo.batch_size) == (0.5, 10_000, 8)


def test_a_discovery_key_goes_to_any_discoverer_and_a_section_to_its_own(plugins: Plugins) -> None:
    section = Sections.of(plugins, []).discovery
    patches = [{"training_count": 50, "kl": {"epsilon_cv": 2.0}, "paired": {"max_actions": 9}}, {"kl": {"patience": 7}}]
    kl = section.resolve(patches)
    assert (kl.training_count, kl.options.epsilon_cv, kl.options.patience) == (50, 2.0, 7)
    paired = section.resolve([*patches, {"discoverer": "paired"}])
    assert (paired.discoverer, paired.training_count, paired.options.max_actions) == ("paired", 50, 9)
    paper = section.resolve([{"preset": "paper"}])
    assert (paper.training_count, paper.options) == (5_000, plugins.discoverers["kl"].presets["paper"])


@dataclass(frozen=True)
class Mine:
    """Settings of a stranger's learner: `tau` means something else than SAC's."""

    tau: Annotated[int, Gt(0)] = 3
    width: Annotated[float, Gt(0)] = 0.1

    def __post_init__(self) -> None:
        if self.width > self.tau:
            raise ValueError("width must not exceed tau")


@pytest.fixture
def stranger(plugins: Plugins) -> Plugins:
    learner = Learner("Mine", Mine, train=lambda problem: None)
    method = Method("mMine", "Mine", "full", "scalar", "none")
    return dataclasses.replace(
        plugins,
        learners=plugins.learners | {"Mine": learner},
        methods=plugins.methods | {"mMine": method},
    )


def test_a_strangers_settings_are_checked_like_ours(tmp_path: Path, stranger: Plugins) -> None:
    text = GOOD.replace("mPPO]", "mPPO, mMine]").replace("PPO: {", "width: 0.2\n  PPO: {")
    file = load(tmp_path, text, stranger)
    assert file.sections.learner.resolve("Mine", [file.suite.learner]) == Mine(width=0.2)  # has no preset `quick`
    assert refused(tmp_path, text.replace("width: 0.2", "widht: 1"), stranger).startswith(
        "17: learner.widht: unknown key. Did you mean 'width'?"
    )
    assert refused(tmp_path, text.replace("width: 0.2", "width: -1"), stranger).startswith(
        "17: learner.width: should be greater than 0, got -1"
    )
    # A shared key must suit every learner that has it, and SAC's `tau` is a number of another kind.
    assert refused(tmp_path, text.replace("width: 0.2", "tau: 0.5"), stranger).startswith("17: learner.tau: should be")
    sac, mine = (
        load(
            tmp_path, text.replace("width: 0.2", "SAC: {tau: 0.5}\n  Mine: {tau: 2}"), stranger
        ).sections.learner.resolve(name, [{"SAC": {"tau": 0.5}, "Mine": {"tau": 2}}])
        for name in ("SAC", "Mine")
    )
    assert (sac.tau, mine.tau) == (0.5, 2)


def test_a_method_whose_learner_does_not_exist_is_named(tmp_path: Path, stranger: Plugins) -> None:
    del stranger.learners["Mine"]
    message = refused(tmp_path, GOOD.replace("mPPO]", "mPPO, mMine]"), stranger)
    assert message.startswith("5: methods.3: method 'mMine' trains with an unknown learner 'Mine'. Known: PPO, SAC")
