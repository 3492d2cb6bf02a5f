"""How finished policies do on the other backends of their run, without training there."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from causalbench.core.learners.evaluation import Player, summary
from causalbench.core.learners.records import Transfer
from causalbench.errors import UserError
from causalbench.run.policies import finished, trained
from causalbench.store.beside import TRANSFER, write_beside
from causalbench.store.cells import StoredCell
from causalbench.store.run_folder import RunFolder


def play_elsewhere(run: RunFolder, only: Sequence[str], episodes: int) -> Iterator[str]:
    """Write `transfer.csv` beside the results of every finished policy that `only` keeps; a sentence for each.

    Each policy plays `episodes` deterministic and as many sampled episodes on every other backend of the run, from the
    starts of its evaluations. Raises `UserError` when there is no policy, or no other backend.
    """
    places = {cell.backend: cell.identity["backend"] for cell in run.cells()}
    for cell in finished(run, only):
        others = {name: place for name, place in places.items() if name != cell.backend}
        if not others:
            raise UserError(f"{run.path}: all of it is on {cell.backend}; a transfer needs a run on several backends")
        rows = [_transfer(cell, name, place, episodes) for name, place in others.items()]
        write_beside(cell.folder, TRANSFER, rows)
        said = ", ".join(f"{row.success_deterministic:.2f} on {row.played_on}" for row in rows)
        yield f"{cell.method} of {cell.backend}, seed {cell.seed}: {said}"


def _transfer(cell: StoredCell, name: str, place: Mapping[str, Any], episodes: int) -> Transfer:
    ready = trained(cell, place)
    with ready.worlds(1) as worlds:
        player = Player(worlds, ready.first_start)
        certain, sampled = (player.play(ready.policy, range(episodes), mode) for mode in (True, False))
    share = sum(episode.success for episode in sampled) / episodes
    found = summary(cell.status.env_steps, certain, sampled, share)
    return Transfer(
        played_on=name,
        episodes=episodes,
        success_deterministic=found.success_deterministic,
        success_sampled=share,
        reversals_per_episode=found.reversals_per_episode,
        mean_final_stage=found.mean_final_stage,
    )
