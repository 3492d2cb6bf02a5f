"""The number of every format of file that causalbench writes; each file says its own under the key `schema`.

A number is raised by any change after which a reader of one version would misread a file of the other. Nothing reads
two: a file with another number is refused in one sentence that says what to do, which is to make it again, or to read
it with the version of causalbench that wrote it.
"""

from typing import Final, Literal

SUITE: Final = 1
"""A suite file, which people write."""
RUN: Final = 2
"""A run folder as a whole: `run.json`, `environment.json`."""
CELL: Final = 3
"""The folder of a cell: `cell.json`, `status.json`, `progress.csv`, `episodes.csv`, `counts.json`."""
GRAPH: Final = 5
"""A causal graph, `graph.json`."""
CHECKPOINT: Final = 5
"""What a training run that was interrupted, or has a larger budget now, continues from."""
POLICY: Final = 4
"""A trained policy, `policy.json` and `policy.safetensors`."""
SAMPLES: Final = 2
"""The samples of a discovery, one .npz a set."""
SNAPSHOT: Final = 2
"""The bytes of a scene's snapshot."""

SuiteFormat = Literal[1]
"""`SUITE` as a type, which a suite's schema is checked by."""
