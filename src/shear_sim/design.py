"""The design of a study: which changes of the base make its points.

A study changes its base by scenes (named sets of changes, side by side) and by the blocks of its
sweep. The jobs of all blocks are added up; inside a block scenes, grid, zip, list and sobol
multiply. Changes are named by dotted keys: ``model.links.cut: bulk``. A section given as a change
changes the keys it names; one that names a ``kind`` starts afresh: ``model.contact_law: {kind:
plateau}``. At one point every key is changed once at most, so that no order can matter.
"""

import itertools
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Annotated, Any, Literal, NamedTuple, Self

from pydantic import BeforeValidator, Field, ValidationError, model_validator

from shear_sim.config import Complaint, complaints, one_of, touches, without
from shear_sim.document import Key, round12
from shear_sim.schema import Impossible, Section
from shear_sim.streams import Streams

MAX_POINTS = 100_000  # of one block, all scenes together
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.+-]*")


class Change(NamedTuple):
    """One value that differs from the base."""

    key: tuple[str, ...]  # where in the point
    value: Any
    origin: Key  # where in the file


Changes = tuple[Change, ...]


def _axis(value: object) -> object:
    """Return the values of an axis: a list as it is, or evenly spaced ones."""
    if isinstance(value, list) and value:
        return tuple(value)
    if isinstance(value, dict) and len(value) == 1:
        (how, ends), *_ = value.items()
        if how in {"linspace", "logspace"}:
            return _spaced(how, ends)
    msg = (
        "must be a list of values, {linspace: [first, last, number]} or "
        "{logspace: [first, last, number]}"
    )
    raise ValueError(msg)


def _spaced(how: str, ends: object) -> tuple[float, ...]:
    match ends:
        case [int() | float() as first, int() | float() as last, int(number)] if (
            not any(isinstance(end, bool) for end in ends)
            and 2 <= number <= MAX_POINTS
            and max(abs(first), abs(last)) < 1e300
        ):
            pass
        case _:
            msg = f"{how} takes [first, last, number]: two numbers and how many values, at least 2"
            raise ValueError(msg)
    steps = [i / (number - 1) for i in range(1, number - 1)]
    if how == "linspace":
        inner = [first + (last - first) * step for step in steps]
    elif first > 0 and last > 0:
        inner = [first * (last / first) ** step for step in steps]
    else:
        msg = "logspace needs values above 0, and takes the values themselves, not their exponents"
        raise ValueError(msg)
    values = [round12(value) for value in (first, *inner, last)]
    # A whole number of discs or of steps is not written 10.0.
    if isinstance(first, int) and isinstance(last, int):
        return tuple(int(value) if value.is_integer() else value for value in values)
    return tuple(values)


def _one_or_more(value: object) -> object:
    if not isinstance(value, dict | list | tuple):
        msg = "must be a section, `{grid: ...}`, or a list of sections"
        raise ValueError(msg)
    return [value] if isinstance(value, dict) else value


def _some(value: object) -> object:
    if value in ([], {}):
        msg = "must not be empty"
        raise ValueError(msg)
    return value


def _empty(value: object) -> object:
    return {} if value is None else value


Axis = Annotated[tuple[Any, ...], BeforeValidator(_axis)]
Named = Annotated[dict[str, Any], BeforeValidator(_empty)]


class Range(Section):
    """One direction of a Sobol design."""

    low: Annotated[float, Field(alias="from")]
    high: Annotated[float, Field(alias="to")]
    scale: Literal["linear", "log", "integer"] = "linear"

    @model_validator(mode="after")
    def _span(self) -> Self:
        problems: list[tuple[tuple[str, ...], str]] = []
        if not self.low < self.high:
            problems.append((("to", "from"), f"must be above from, {self.low:g}"))
        if self.scale == "log" and self.low <= 0:
            problems.append((("from", "scale"), "scale: log needs values above 0"))
        if self.scale == "integer" and not (self.low.is_integer() and self.high.is_integer()):
            problems.append((("from", "scale"), "scale: integer needs whole numbers"))
        if problems:
            raise Impossible(problems)
        return self

    def value(self, u: float) -> float | int:
        """Return the value at ``u``, uniform in [0, 1)."""
        if self.scale == "integer":
            return int(self.low + math.floor(u * (self.high - self.low + 1)))
        if self.scale == "log":
            return round12(self.low * (self.high / self.low) ** u)
        return round12(self.low + (self.high - self.low) * u)


class Sobol(Section):
    """A scrambled Sobol design: more points keep the old ones."""

    points: Annotated[int, Field(ge=1, le=MAX_POINTS, description="best a power of 2")]
    ranges: Annotated[dict[str, Range], BeforeValidator(_some)]


class Block(Section):
    """One block of the sweep."""

    name: str | None = None
    scenes: Annotated[tuple[str, ...] | None, Field(strict=False), BeforeValidator(_some)] = None
    grid: Annotated[dict[str, Axis], Field(default_factory=dict)]
    paired: Annotated[dict[str, Axis], Field(alias="zip", default_factory=dict)]
    listed: Annotated[tuple[Named, ...], Field(alias="list", strict=False)] = ()
    sobol: Sobol | None = None
    fixed: Annotated[Named, Field(alias="set", default_factory=dict)]


class Design(Section):
    """The keys of a study file that are not sections of its model."""

    scenes: Annotated[dict[str, Named], Field(default_factory=dict)]
    sweep: Annotated[
        tuple[Block, ...],
        Field(strict=False),
        BeforeValidator(_some),
        BeforeValidator(_one_or_more),  # the last one comes first
    ] = (Block.model_validate({}),)
    replicates: Annotated[int, Field(ge=1, le=10_000, description="jobs of each point")] = 1
    seed: Annotated[int, Field(ge=0, lt=2**63, description="of all random numbers")] = 0
    threads: Annotated[
        int,
        Field(ge=1, le=64, description="most cores of one job; its bits stay the same"),
    ] = 1


KEYS = tuple(Design.model_fields)


class Variant(NamedTuple):
    """A point before validation: what changes, and the block and scene that want it.

    It is not ``complete`` if something of its block or scene is wrong and was left out.
    """

    label: tuple[str, str]
    changes: Changes
    complete: bool = True


class Draft(NamedTuple):
    """A design as far as it is right: what is wrong with the rest, and the blocks that lack it."""

    design: Design
    complaints: list[Complaint]
    torn: frozenset[int]


def read_design(data: dict[str, Any]) -> Draft:
    """Validate the keys of a study file; leave out what is wrong and go on with the rest.

    In the complaints ``sweep`` is a list, also where the file holds a single block.
    """
    sweep = data.get("sweep")
    if isinstance(sweep, dict) and sweep:
        data = {**data, "sweep": [sweep]}
    found: list[Complaint] = []
    removed: set[Key] = set()
    while True:
        try:
            design = Design.model_validate(data)
        except ValidationError as error:
            before = frozenset(removed)
            for complaint in complaints(error, Design):
                if not touches(complaint, before):
                    found.append(complaint)
                key = complaint.keys[0]
                while key in before:  # leaving it out was not enough: a key that must be there
                    key = key[:-1]
                removed.add(key)
                if len(key) == 2 and key[0] == "scenes":  # blocks may name it
                    data = {**data, "scenes": {**data["scenes"], key[1]: {}}}
                else:
                    data = without(data, key)
        else:
            break
    if ("scenes",) in removed:  # then no scene is known, and none can be called unknown
        blocks = tuple(block.model_copy(update={"scenes": None}) for block in design.sweep)
        design = design.model_copy(update={"sweep": blocks})
    every = any(key in {(), ("sweep",)} or key[0] == "scenes" for key in removed)
    torn = (
        number
        for number in range(len(design.sweep))
        if every or any(key[:2] == ("sweep", number) for key in removed)
    )
    return Draft(design, found, frozenset(torn))


def changes_of(mapping: Mapping[str, Any], origin: Key, key: tuple[str, ...] = ()) -> Changes:
    """Return the changes that ``mapping`` (dotted keys, or sections) asks for."""
    found: list[Change] = []
    for name, value in mapping.items():
        where, source = (*key, *name.split(".")), (*origin, name)
        if isinstance(value, dict) and "kind" not in value:
            found.extend(changes_of(value, source, where))
        else:
            found.append(Change(where, value, source))
    return tuple(found)


def _leaves(changes: Sequence[Change]) -> Iterator[tuple[str, ...]]:
    for change in changes:
        if isinstance(change.value, dict):
            inner = changes_of({k: v for k, v in change.value.items() if k != "kind"}, ())
            yield (*change.key, "kind")
            yield from ((*change.key, *leaf) for leaf in _leaves(inner))
        else:
            yield change.key


def apply(base: dict[str, Any], changes: Changes) -> dict[str, Any]:
    """Return ``base`` with ``changes``; neither is modified."""
    data = dict(base)
    # Sections that start afresh come before the keys inside them.
    for change in sorted(changes, key=lambda change: len(change.key)):
        node = data
        for part in change.key[:-1]:
            child = node.get(part)
            node[part] = node = dict(child) if isinstance(child, dict) else {}
        node[change.key[-1]] = change.value
    return data


class _Axis(NamedTuple):
    """Alternatives, one of which every point of a block takes."""

    origin: Key
    alternatives: list[Changes]

    @property
    def how(self) -> str:
        """Return the key of the block that asks for these alternatives."""
        return next(str(part) for part in self.origin[1:] if isinstance(part, str))


def expand(draft: Draft, raw_sweep: object) -> Iterator[Variant | Complaint]:
    """Yield the points of all blocks, and what does not fit together in the design.

    Parameters
    ----------
    draft : Draft
        The validated keys.
    raw_sweep : object
        ``sweep`` as the file holds it: one block is not a list there.
    """
    design = draft.design
    scenes = {
        name: changes_of(changes, ("scenes", name)) for name, changes in design.scenes.items()
    } or {"base": ()}
    for name in scenes:
        yield from _bad_name(name, ("scenes", name))
    names: dict[str, Key] = {}
    for number, block in enumerate(design.sweep):
        origin: Key = ("sweep", number) if isinstance(raw_sweep, list) else ("sweep",)
        default = f"sweep{number + 1}" if raw_sweep is not None else "base"
        name = block.name or default
        yield from _bad_name(name, (*origin, "name"))
        if name in names:
            yield Complaint(((*origin, "name"),), "names two blocks: choose another")
        names[name] = origin
        for found in _expand_block(block, name, origin, scenes, design.seed):
            if number in draft.torn and isinstance(found, Variant):
                yield found._replace(complete=False)
            else:
                yield found


def _bad_name(name: str, key: Key) -> Iterator[Complaint]:
    if not _NAME.fullmatch(name):
        message = "names are letters, digits and _ . + - (they become labels and file names)"
        yield Complaint((key,), message)


def _expand_block(
    block: Block, name: str, origin: Key, scenes: Mapping[str, Changes], seed: int
) -> Iterator[Variant | Complaint]:
    wanted = tuple(scenes) if block.scenes is None else block.scenes
    wrong = list(_bad_scenes(wanted, tuple(scenes), (*origin, "scenes")))
    axes: list[_Axis] = []
    for part in _axes(block, origin, seed):
        if isinstance(part, Complaint):
            wrong.append(part)
        else:
            axes.append(part)
    points = math.prod(len(axis.alternatives) for axis in axes) * len(wanted)
    if points > MAX_POINTS:
        message = f"makes {points:,} points, more than {MAX_POINTS:,}: split the study"
        yield from (*wrong, Complaint((origin,), message))
        return
    if not wrong:
        for scene in wanted:
            wrong.extend(_changed_twice(scene, scenes[scene], axes))
    yield from wrong
    for scene in dict.fromkeys(wanted):
        for choice in itertools.product(*(axis.alternatives for axis in axes)):
            yield Variant((name, scene), sum(choice, scenes.get(scene, ())), not wrong)


def _bad_scenes(wanted: Sequence[str], known: Sequence[str], key: Key) -> Iterator[Complaint]:
    names, before = set(known), set[str]()  # there may be many thousand
    for i, scene in enumerate(wanted):
        if scene not in names:
            yield Complaint(((*key, i),), f"is no scene: {one_of(scene, known)}")
        elif scene in before:
            yield Complaint(((*key, i),), "is listed twice")
        before.add(scene)


def _axes(block: Block, origin: Key, seed: int) -> Iterator[_Axis | Complaint]:
    """Yield the axes of a block, whose alternatives multiply."""
    if block.fixed:
        yield _Axis((*origin, "set"), [changes_of(block.fixed, (*origin, "set"))])
    for name, values in block.grid.items():
        key = (*origin, "grid", name)
        yield _Axis(key, [_chosen(name, value, (*key, i)) for i, value in enumerate(values)])
    if block.paired:
        lengths = {name: len(values) for name, values in block.paired.items()}
        if len(set(lengths.values())) > 1:
            message = "needs lists of one length, here " + ", ".join(
                f"{name} has {length}" for name, length in lengths.items()
            )
            yield Complaint(((*origin, "zip"),), message)
        yield _Axis(
            (*origin, "zip"),
            [
                sum(
                    (
                        _chosen(name, values[i], (*origin, "zip", name, i))
                        for name, values in block.paired.items()
                        if i < len(values)
                    ),
                    (),
                )
                for i in range(max(lengths.values()))
            ],
        )
    if block.listed:
        key = (*origin, "list")
        yield _Axis(key, [changes_of(entry, (*key, i)) for i, entry in enumerate(block.listed)])
    if block.sobol:
        yield _Axis((*origin, "sobol"), sobol_points(block.sobol, (*origin, "sobol"), seed))


def _chosen(name: str, value: Any, origin: Key) -> Changes:
    """Return the changes of one value of an axis."""
    key = tuple(name.split("."))
    if isinstance(value, dict) and "kind" not in value:
        return changes_of(value, origin, key)
    return (Change(key, value, origin),)


def sobol_points(sobol: Sobol, origin: Key, seed: int) -> list[Changes]:
    """Return the points of a scrambled Sobol design, the same first ones for any number.

    The scrambling is seeded from the study's seed and the names of the keys, which are taken in
    alphabetical order: neither the order in the file nor another block can change a design.
    """
    from scipy.stats import qmc  # 1 s to import, and few studies need it

    names = sorted(sobol.ranges)
    rng = Streams(seed, 0).generator("sobol " + " ".join(names))
    sampler = qmc.Sobol(len(names), scramble=True, rng=rng)
    # Sobol designs come in powers of 2, and warn about any other number.
    sample = sampler.random_base2((sobol.points - 1).bit_length())[: sobol.points]
    return [
        tuple(
            Change(tuple(name.split(".")), sobol.ranges[name].value(u), (*origin, "ranges", name))
            for name, u in zip(names, row, strict=True)
        )
        for row in sample.tolist()
    ]


def _changed_twice(scene: str, of_scene: Changes, axes: Sequence[_Axis]) -> Iterator[Complaint]:
    """Yield the keys that a scene and a block, or two axes of it, both change."""
    first: dict[tuple[str, ...], str] = {}
    for axis in [_Axis(("scenes", scene), [of_scene]), *axes]:
        mine: dict[tuple[str, ...], None] = {}
        for alternative in axis.alternatives:
            leaves = list(_leaves(alternative))
            if len(set(leaves)) < len(leaves):
                twice = next(leaf for leaf in leaves if leaves.count(leaf) > 1)
                message = f"changes {'.'.join(twice)} twice at one point"
                yield Complaint((axis.origin,), message)
            mine |= dict.fromkeys(leaves)
        for leaf in mine:
            for other in (leaf[:n] for n in range(1, len(leaf) + 1)):
                if other in first and (other == leaf or other[-1] != "kind"):
                    message = f"{'.'.join(other)} is changed by {first[other]} already: once only"
                    yield Complaint((axis.origin,), message)
        source = f"scene {scene}" if axis.origin[0] == "scenes" else f"`{axis.how}`"
        first |= dict.fromkeys(mine, source)
