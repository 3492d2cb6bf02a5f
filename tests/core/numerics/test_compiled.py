"""The slower paths: the same numbers where nothing can be compiled or kept, and a sentence about it."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from causalbench.core.numerics import compiled
from causalbench.core.numerics.gufunc import broadcast, interpreted

EPISODE = """
import sys
import numpy as np
from causalbench import make_env
from causalbench.conformance.moves import row

env = make_env(backend=sys.argv[1])
env.reset(seed=0)
rows, done = [], False
while not done:
    _, reward, success, truncated, info = env.step(env.worlds.expert())
    rows.append([*row(env.worlds.facts), *info["vector_reward"], info["stage"]])
    done = success or truncated
np.save(sys.argv[2], rows)
sys.exit(not success)
"""
"""The scripted expert solves one episode; what it saw is written to a file."""


def play(backend: str, file: Path, **environment: str) -> tuple[np.ndarray, str]:
    """What the expert saw, and stderr."""
    command = [sys.executable, "-c", EPISODE, backend, str(file)]
    done = subprocess.run(command, capture_output=True, text=True, env=os.environ | environment)
    assert done.returncode == 0, done.stderr
    return np.load(file), done.stderr


@pytest.fixture
def no_numba(tmp_path: Path) -> str:
    """A search path on which numba is broken."""
    (tmp_path / "site" / "numba").mkdir(parents=True)
    (tmp_path / "site" / "numba" / "__init__.py").write_text("raise ImportError('Numba needs NumPy 1.0 or less')\n")
    return os.pathsep.join(filter(None, [str(tmp_path / "site"), os.environ.get("PYTHONPATH")]))


@pytest.mark.parametrize("backend", ["kinematic", "gymrob"])
def test_without_a_compiler_the_expert_sees_the_same(backend: str, tmp_path: Path, no_numba: str) -> None:
    fast, _ = play(backend, tmp_path / "fast.npy")
    for cause, environment in (
        ("NUMBA_DISABLE_JIT is set", {"NUMBA_DISABLE_JIT": "1"}),
        ("numba cannot be imported (ImportError: Numba needs NumPy 1.0 or less)", {"PYTHONPATH": no_numba}),
    ):
        slow, said = play(backend, tmp_path / "slow.npy", **environment)
        assert said == f"causalbench runs its inner loops as plain Python, many times slower, since {cause}\n"
        np.testing.assert_allclose(slow, fast, rtol=0, atol=1e-9)


COMPILES = """
import numpy as np
from causalbench.core.numerics.gufunc import broadcast
@broadcast("f8[:], f8[:]", "(n)->(n)")
def double(x, out):
    for i in range(len(x)):
        out[i] = 2 * x[i]
print(double(np.array([1.0, 2.0])))
"""


def run_module(folder: Path, **environment: str) -> str:
    """What a program that compiles one function says on stderr."""
    (folder / "program.py").write_text(COMPILES)
    command = [sys.executable, str(folder / "program.py")]
    done = subprocess.run(command, capture_output=True, text=True, env=os.environ | environment)
    assert (done.returncode, done.stdout) == (0, "[2. 4.]\n"), done.stderr
    return done.stderr


def test_compilation_is_announced_once_a_machine(tmp_path: Path) -> None:
    said = run_module(tmp_path, NUMBA_CACHE_DIR=str(tmp_path / "cache"))
    assert said.count("\n") == 1
    assert "is compiling inner loops that this machine has not run yet" in said
    assert f"Cached in {tmp_path / 'cache'}" in said
    assert run_module(tmp_path, NUMBA_CACHE_DIR=str(tmp_path / "cache")) == ""


@pytest.fixture
def no_cache(tmp_path: Path) -> dict[str, str]:
    """An environment in which numba finds no folder to write to, and a temporary directory."""
    (tmp_path / "file").write_text("a file where a folder must be")
    (tmp_path / "temporary").mkdir()
    return {
        "NUMBA_CACHE_DIR": str(tmp_path / "file"), "NUMBA_CACHE_LOCATOR_CLASSES": "UserProvidedCacheLocator",
        "TMPDIR": str(tmp_path / "temporary"),
    }  # fmt: skip


def test_without_a_folder_for_the_cache_a_private_temporary_one_serves(
    tmp_path: Path, no_cache: dict[str, str]
) -> None:
    said = run_module(tmp_path, **no_cache)
    folder = tmp_path / "temporary" / f"causalbench-numba-{os.getuid()}"
    assert f"keeps compiled code in {folder}" in said
    assert folder.stat().st_mode & 0o777 == 0o700
    assert run_module(tmp_path, **no_cache) == ""


def test_where_others_could_write_to_that_too_every_process_compiles(tmp_path: Path, no_cache: dict[str, str]) -> None:
    folder = tmp_path / "temporary" / f"causalbench-numba-{os.getuid()}"
    folder.mkdir()
    folder.chmod(0o777)
    for _ in range(2):
        said = run_module(tmp_path, **no_cache)
        assert said.count("\n") == 1
        assert "cannot keep compiled code, so every process compiles it again" in said
        assert "set NUMBA_CACHE_DIR" in said


def fill(a: np.ndarray, index: int, b: np.ndarray, out: np.ndarray) -> None:
    out[0] = a[index] + b[0]
    out[1] = b[1] * index


TYPES, LAYOUT = "f8[:], i8, f8[:], f8[:]", "(n),(),(p)->(p)"


@pytest.mark.parametrize("batches", [((), (), ()), ((4,), (), (4,)), ((4,), (3, 4), ())])
def test_the_interpreted_function_broadcasts_as_the_compiled_one(batches: tuple[tuple[int, ...], ...]) -> None:
    rng = np.random.default_rng(0)
    a, index, b = rng.normal(size=(*batches[0], 5)), rng.integers(5, size=batches[1]), rng.normal(size=(*batches[2], 2))
    expected, found = broadcast(TYPES, LAYOUT)(fill)(a, index, b), interpreted(fill, TYPES, LAYOUT)(a, index, b)
    assert found.dtype == expected.dtype
    np.testing.assert_array_equal(found, expected)


def test_the_folder_of_the_cache_is_numbas_own_answer() -> None:
    assert compiled.problem() == ""
    assert Path(compiled.cache_folder()).is_dir()


PARTS = {
    "constants.py": "FACTOR, TABLE = 2.0, (3.0, 4.0)\n",
    "records.py": "from typing import NamedTuple\nclass Pair(NamedTuple):\n    first: float\n    second: float\n",
    "library.py": """
import ctypes.util
from causalbench.core.numerics.compiled import external
flush = external(ctypes.util.find_library("m"), "fesetround", "int32")
""",
    "inner.py": """
from causalbench.core.numerics.compiled import compiled
from constants import FACTOR
@compiled
def scaled(x):
    return FACTOR * x
""",
    "middle.py": """
import inner
from causalbench.core.numerics.compiled import compiled
@compiled
def twice(x):
    return inner.scaled(x) + inner.scaled(x)
""",
    "program.py": """
import numpy as np
import constants
from causalbench.core.numerics.compiled import compiled
from causalbench.core.numerics.gufunc import broadcast
from library import flush
from middle import twice
from records import Pair
@compiled
def tabled(x):
    flush(0)
    return x * constants.TABLE[1]
@compiled
def first(pair):
    return pair.first
@broadcast("f8, f8[:]", "()->()")
def all_of_it(x, out):
    out[0] = twice(tabled(x))
print(twice(1.0), tabled(1.0), all_of_it(1.0), first(Pair(first=5.0, second=6.0)))
""",
}


def run_parts(folder: Path) -> tuple[str, bool]:
    """What the program prints, and whether something was compiled for it."""
    for name, text in PARTS.items():
        if not (folder / name).exists():
            (folder / name).write_text(text)
    environment = os.environ | {"NUMBA_CACHE_DIR": str(folder / "cache"), "PYTHONDONTWRITEBYTECODE": "1"}
    done = subprocess.run([sys.executable, folder / "program.py"], capture_output=True, text=True, env=environment)
    assert done.returncode == 0, done.stderr
    return done.stdout, "is compiling" in done.stderr


CHANGES = [
    ("inner.py", "FACTOR * x", "FACTOR * x + 1", "6.0 4.0 18.0 5.0"),
    ("constants.py", "2.0", "7.0", "16.0 4.0 58.0 5.0"),
    ("constants.py", "4.0", "9.0", "16.0 9.0 128.0 5.0"),
    ("library.py", "int32", "address", "16.0 9.0 128.0 5.0"),
    ("records.py", "first: float\n    second: float", "second: float\n    first: float", "16.0 9.0 128.0 5.0"),
]
"""File, what is replaced by what, and what the program then prints: each change stays."""


@pytest.mark.long
def test_kept_code_is_compiled_anew_when_what_is_in_it_changes_elsewhere(tmp_path: Path) -> None:
    assert run_parts(tmp_path) == ("4.0 4.0 16.0 5.0\n", True)
    assert run_parts(tmp_path) == ("4.0 4.0 16.0 5.0\n", False)
    for file, old, new, expected in CHANGES:
        text = (tmp_path / file).read_text()
        (tmp_path / file).write_text(text.replace(old, new))
        assert run_parts(tmp_path) == (f"{expected}\n", True), (file, new)
    assert run_parts(tmp_path) == (f"{expected}\n", False)
