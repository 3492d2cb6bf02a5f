"""The causal graph that a row of the method table trains with."""

from __future__ import annotations

from contextlib import closing

from causalbench.core.discovery.graph import CausalGraph, manual_graph
from causalbench.core.discovery.truth.oracle import ORACLE_STATES, consult_oracle, oracle_graph
from causalbench.core.learners.controls import control_graph
from causalbench.core.learners.methods import Method
from causalbench.core.staged.worlds import MakeWorlds
from causalbench.core.tasks.stage_task import StageTask
from causalbench.errors import InvalidGraphError


def training_graph(
    task: StageTask,
    method: Method,
    graph: CausalGraph | None,
    make_worlds: MakeWorlds,
    seed: int,
    action_repeat: int = 1,
) -> CausalGraph | None:
    """`graph` is the discovered one where the method asks for it; all others are found or drawn here.

    An oracle is asked about actions held for `action_repeat` control steps, as those of a discovery would be. A graph
    that was drawn here before is taken as it is. Raises `InvalidGraphError` for a missing or wrong graph.
    """
    if method.matrix == "none":
        return None
    if graph is None or graph.origin in ("discovered", "manual"):
        graph = _found(task, method, graph, make_worlds, seed, action_repeat)
    graph.check(task)
    return graph


def _found(
    task: StageTask,
    method: Method,
    graph: CausalGraph | None,
    make_worlds: MakeWorlds,
    seed: int,
    action_repeat: int,
) -> CausalGraph:
    if method.matrix == "manual":
        return manual_graph(task)
    if method.matrix == "oracle":
        truth = consult_oracle(task, make_worlds, ORACLE_STATES, seed, lambda share, text: None, action_repeat)
        return oracle_graph(task, truth, seed)
    if graph is None:
        raise InvalidGraphError(f"method {method.name!r} needs a discovered causal graph of {task.name}, got none")
    graph.check(task)
    _check_discoverer(method, graph)
    if method.control == "none":
        return graph
    with closing(make_worlds(1)) as worlds:
        return control_graph(method.control, graph, worlds, seed)


def _check_discoverer(method: Method, graph: CausalGraph) -> None:
    found_by = graph.provenance["settings"]["discoverer"] if graph.origin == "discovered" else method.discoverer
    if method.discoverer not in ("", found_by):
        raise InvalidGraphError(
            f"method {method.name!r} needs a graph by the discoverer {method.discoverer!r}, and causal graph "
            f"{graph.hash} is by {found_by!r}; discover again with it"
        )
