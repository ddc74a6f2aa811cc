"""The relational network: what it may not depend on, and what it shares between reaches."""

from __future__ import annotations

from functools import partial

import pytest
import torch
from omegaconf import OmegaConf

from dore.app.build import MODEL
from dore.app.training import trainer_of
from dore.errors import InputError
from dore.learn.agents.common import agent_from_config
from dore.learn.checkpoint import save_model
from dore.learn.features import encode
from dore.learn.relations import RelationNet, graph_of
from dore.planners.learned import Learned
from dore.world.board import bit, pack
from dore.world.generator import Difficulty, FreshInstances
from dore.world.layout import Layout
from dore.world.mirror import mirrored_cell
from dore.world.problem import Batch
from dore.world.reach import Reach
from dore.world.rules import accessibility
from tests.app.test_conf import compose
from tests.drawings import WIDE_HAND, wide_hand
from tests.learn.test_worlds import SETTINGS, small

SMALL = partial(RelationNet, width=8, blocks=2)
ARC = tuple((0.5 + 0.13 * (i // 5) - 0.02 * abs(i % 5 - 2), 0.13 * (i % 5) - 0.24) for i in range(13))
REACHES = {"grid": wide_hand(4, 5), "irregular": Reach(Layout(ARC, 0.1), **WIDE_HAND)}
EVERY_REACH = pytest.mark.parametrize("reach", REACHES.values(), ids=REACHES)


def network(reach: Reach, n_planes: int = 3, **given) -> RelationNet:
    torch.manual_seed(0)
    return RelationNet(reach, n_planes, (reach.n_cells, reach.n_cells), **{"width": 8, "blocks": 2, **given})


def boards(reach: Reach, n: int = 30) -> tuple[torch.Tensor, torch.Tensor]:
    return FreshInstances(reach, Difficulty(2, 6), "train", 0).draw(n)


def seen(reach: Reach, board: torch.Tensor, target: torch.Tensor) -> torch.Tensor:
    return encode(reach, board, target, accessibility(reach, board, target).pick, "planes")


def relabelled(reach: Reach, order: torch.Tensor) -> Reach:
    """The same table with its cells numbered in another order; `order`: the old number of each."""
    cells = tuple(tuple(centre) for centre in reach.layout.centres[order].tolist())
    return Reach(Layout(cells, reach.layout.cell_m), **WIDE_HAND)


@EVERY_REACH
def test_how_cells_are_numbered_does_not_matter(reach):
    order = torch.randperm(reach.n_cells, generator=torch.Generator().manual_seed(1))
    net, planes = network(reach), seen(reach, *boards(reach))
    assert planes[:, 0].any(0).all()
    for values, other in zip(net(planes), net.on(relabelled(reach, order))(planes[..., order]), strict=True):
        assert values.std() > 1e-3
        torch.testing.assert_close(values[:, order], other)


def test_left_and_right_are_told_apart_by_where_a_cell_is_alone():
    """Without the y coordinate, mirrored boards have mirrored values; with it they need not."""
    reach = REACHES["grid"]
    net, planes = network(reach), seen(reach, *boards(reach))
    image = mirrored_cell(torch.arange(reach.n_cells), reach)
    there = net(planes)[0][:, image]
    assert not torch.allclose(there, net(planes[..., image])[0], atol=1e-4)
    with torch.no_grad():
        net.stem.weight[:, -1] = 0
    torch.testing.assert_close(net(planes)[0][:, image], net(planes[..., image])[0])


@EVERY_REACH
def test_the_graph_is_the_reachs_table(reach):
    """A cell is accessible where one of its corridors is blocked by nothing."""
    graph = graph_of(reach)
    standing = torch.rand(200, reach.n_cells, generator=torch.Generator().manual_seed(0)) < 0.2
    blocking = graph.blocked_by @ standing[:, graph.order].T.float()
    free = torch.zeros(reach.n_cells, 200).index_add(0, graph.owner, (blocking == 0).float()) > 0
    assert torch.equal(free[graph.rank].T, reach.accessible(standing))
    assert sum(cells for cells, _ in graph.groups) == reach.n_cells
    assert len(graph.owner) == sum(cells * corridors for cells, corridors in graph.groups)


def test_a_cell_without_a_corridor_is_served_too():
    reach = Reach(Layout.grid(4, 6, 0.12), **WIDE_HAND, max_yaw_deg=5.0)
    assert 0 in reach.table.n_corridors
    planes = seen(reach, *boards(reach))
    assert all(value.isfinite().all() for value in network(reach)(planes))


@pytest.mark.parametrize("max_yaw_deg", [None, 5.0])
def test_a_board_alone_has_the_values_that_it_has_in_a_batch(max_yaw_deg):
    """The maximum over a cell's corridors is computed in another way for few boards; some cells have none."""
    reach = Reach(Layout.grid(4, 6, 0.12), **WIDE_HAND, max_yaw_deg=max_yaw_deg)
    net, planes = network(reach), seen(reach, *boards(reach))
    for head, together in enumerate(net(planes)):
        with torch.no_grad():
            alone = torch.cat([net(planes[row : row + 1])[head] for row in range(len(planes))])
        torch.testing.assert_close(together, alone)


def test_no_boards_have_no_values():
    reach = REACHES["grid"]
    with torch.no_grad():
        assert [value.shape for value in network(reach)(torch.empty(0, 3, reach.n_cells))] == [(0, 20), (0, 20)]


def test_corridors_that_are_listed_twice_change_nothing():
    """The table is padded where cells have fewer corridors than others; sets that contain another are left out."""
    reach = REACHES["grid"]
    graph, table = graph_of(reach), reach.table
    cells = reach.n_cells
    sets = [set(map(tuple, table.corridors[cell, : table.n_corridors[cell]].tolist())) for cell in range(cells)]
    assert len(graph.owner) == sum(map(len, sets)) < table.corridors.shape[0] * table.corridors.shape[1]
    for one in sets:
        assert not any(a != b and a[0] & b[0] == a[0] for a in one for b in one)


def test_a_move_far_away_is_heard():
    """What blocks the way to what blocks the target is two corridors away."""
    reach = REACHES["grid"]
    net = network(reach)
    planes = seen(reach, *boards(reach)).requires_grad_()
    (heard,) = torch.autograd.grad(net(planes)[0][:, 0].sum(), planes)
    assert (heard[:, 0].abs().amax(0) > 0).all()


def test_on_another_reach_it_has_the_same_parameters_and_gradients():
    net = network(REACHES["grid"])
    other = net.on(REACHES["irregular"])
    assert all(one is same for one, same in zip(net.parameters(), other.parameters(), strict=True))
    other(seen(REACHES["irregular"], *boards(REACHES["irregular"])))[0].sum().backward()
    assert all(weight.grad is not None for name, weight in net.named_parameters() if "heads.1" not in name)
    made = network(REACHES["irregular"])
    planes = seen(REACHES["irregular"], *boards(REACHES["irregular"]))
    for values, expected in zip(other(planes), made(planes), strict=True):
        assert torch.equal(values, expected)


def test_the_graph_is_not_among_the_weights():
    net, other = network(REACHES["grid"]), network(REACHES["irregular"])
    other.load_state_dict(net.state_dict())
    default = network(REACHES["grid"], width=32, blocks=3, n_planes=4)
    assert sum(weight.numel() for weight in default.parameters()) < 70_000


def test_a_slot_has_the_value_of_its_obstacles_cell():
    reach = REACHES["grid"]
    torch.manual_seed(0)
    net = RelationNet(reach, 3, (4, reach.n_cells), width=8, blocks=1)
    per_cell = RelationNet(reach, 3, (reach.n_cells, reach.n_cells), width=8, blocks=1)
    per_cell.load_state_dict(net.state_dict())
    board, target = pack(torch.zeros(1, reach.n_cells, dtype=torch.bool)), torch.tensor([10])
    for cell in (17, 2, 5):
        board = board | bit(torch.tensor([cell]), 1)
    planes = seen(reach, board, target)
    (slots, _), (cells, _) = net(planes), per_cell(planes)
    assert torch.equal(slots[0], cells[0, [2, 5, 17, 10]])


TRAINED = (
    *("layout.rows=3", "layout.cols=3", "instances.min_obstacles=1", "instances.max_obstacles=5", *SETTINGS),
    *("network=relations", "agent.encoding=planes", "env.num_envs=4", "training.learning_starts=4"),
    *("ipt.every_episodes=10000", "ipt.batch_size=5"),
)
BOTH_AGENTS = pytest.mark.parametrize("agent", ["agent=single", "agent=sequential", "agent.trunk=shared"])


@BOTH_AGENTS
def test_either_agent_learns_on_several_worlds_with_one_set_of_weights(agent):
    trainer = trainer_of(compose("train", [*TRAINED, agent, *small("wide", 3, 4), "agent.symmetry=true"]))
    first, second = (world.agent for world in trainer.worlds.values())
    assert first.networks.state_dict().keys() == second.networks.state_dict().keys()
    for _ in range(4):
        before = [weight.detach().clone() for weight in second.networks.parameters()]
        trainer.iterate()
        assert any((old != new).any() for old, new in zip(before, second.networks.parameters(), strict=True))
    assert all(one is other for one, other in zip(first.loss.parameters(), second.loss.parameters(), strict=True))


@BOTH_AGENTS
def test_a_saved_model_plans_on_any_reach(agent, tmp_path):
    cfg = compose("train", [*TRAINED, agent])
    trained = trainer_of(cfg).learner.agent
    plain = OmegaConf.to_container(cfg, resolve=True)
    save_model(tmp_path / "m.safetensors", trained.networks.state_dict(), {name: plain[name] for name in MODEL})
    for reach in REACHES.values():
        loaded = Learned(reach, tmp_path / "m.safetensors", 8)
        board, target = boards(reach, 5)
        pick = accessibility(reach, board, target).pick.long().argmax(-1)
        expected = trained.on(reach).move_values(board, target, pick)
        assert torch.equal(loaded.agent.move_values(board, target, pick), expected)
        assert len(loaded.plan(Batch(board, target))) == 5


def test_a_factory_that_wants_the_layout_is_told():
    config = {"network": {"_target_": "tests.learn.test_relations.old_factory", "_partial_": True}}
    agent = OmegaConf.to_container(compose("train", ["layout=3x6"]).agent, resolve=True)
    with pytest.raises(InputError, match=r"^network: .*'reach'; want .* reach.layout is the layout$"):
        agent_from_config({**config, "agent": agent}, wide_hand(3, 6))


def old_factory(layout, n_planes, n_outputs):
    """As networks were made in version 0.1."""


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"n_planes": 2}, "network: relations wants agent.encoding=planes"),
        ({"width": 0}, "network.width: got 0"),
        ({"blocks": 1.5}, "network.blocks: got 1.5"),
    ],
)
def test_what_it_refuses(given, says):
    with pytest.raises(InputError, match=says):
        network(REACHES["grid"], **given)
