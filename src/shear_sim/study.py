"""Studies and their jobs: which simulations a study file asks for, and what names them.

A job is one point (every parameter resolved) with the study's seed and a replicate number. Its id
is a hash of exactly that and of the model's physics version, so results can be found, shared and
reused whatever file asked for them, and a study that grows keeps its old jobs.
"""

import hashlib
import json
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ValidationError

from shear_sim import models
from shear_sim.config import Complaint, all_complaints, one_of, sections_of
from shear_sim.design import (
    KEYS,
    Change,
    Changes,
    Draft,
    apply,
    changes_of,
    expand,
    read_design,
)
from shear_sim.document import (
    NOTHING,
    Document,
    Key,
    Problem,
    StudyError,
    dotted,
    read_yaml,
    round12,
)
from shear_sim.models.interface import Point
from shear_sim.packing import content_digest
from shear_sim.schema import Impossible, Section
from shear_sim.streams import Streams

Labels = tuple[tuple[str, str], ...]


@dataclass(frozen=True)
class Job:
    """One simulation of a study.

    Attributes
    ----------
    id : str
        16 hexadecimal digits of the SHA-256 of everything that can change the result.
    point : Point
        Every parameter, resolved and validated.
    seed, replicate : int
        Seed of the study and number of the replicate, from 0.
    labels : tuple of (block, scene)
        Where the study asks for it; not part of the id.
    threads : int
        Cores that it uses; not part of the id, and never changes a bit of the result.
    """

    id: str
    point: Point
    seed: int
    replicate: int
    labels: Labels = ()
    threads: int = 1

    @classmethod
    def create(cls, point: Point, seed: int, replicate: int, labels: Labels = ()) -> "Job":
        """Return the job of ``point``, its floats rounded to 12 significant digits."""
        point = type(point).model_validate(_rounded(point.model_dump())).resolved()
        key = _canonical(parameters(point))
        return cls(_job_id(point.kind, key, seed, replicate), point, seed, replicate, labels)

    @property
    def streams(self) -> Streams:
        """The random numbers of this job, the same at every point of a study."""
        return Streams(self.seed, self.replicate)

    @property
    def parameters(self) -> dict[str, Any]:
        """Every resolved parameter, JSON-ready and without paths: what the id hashes."""
        return parameters(self.point)

    @property
    def point_id(self) -> str:
        """Id of the point: the same for all replicates and seeds."""
        return _point_id(self.point.kind, _canonical(self.parameters))

    def to_json(self) -> dict[str, Any]:
        """Return everything needed to repeat this job, JSON-ready."""
        return {
            "id": self.id,
            "model": self.point.kind,
            "physics_version": models.model(self.point.kind).PHYSICS_VERSION,
            "seed": self.seed,
            "replicate": self.replicate,
            "labels": [list(label) for label in self.labels],
            "parameters": self.parameters,
            "files": {
                dotted((*key, "file")): str(path)
                for key, section in _readers(self.point)
                if (path := getattr(section, "file")) is not None  # noqa: B009 - any model's section
            },
        }

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> "Job":
        """Return the job that `to_json` wrote (``labels`` and ``files`` may be missing).

        Raises
        ------
        ValueError
            If this version of the program would not compute the same numbers, or a start file
            is not named.
        """
        kind = data["model"]
        version = models.model(kind).PHYSICS_VERSION
        if data["physics_version"] != version:
            msg = (
                f"job {data['id']} was made with physics version {data['physics_version']} of "
                f"model {kind}; this is version {version} and would give other numbers"
            )
            raise ValueError(msg)
        changes = [
            Change(tuple(key.split(".")), path, ()) for key, path in data.get("files", {}).items()
        ]
        point = models.model(kind).POINT.model_validate(
            apply(data["parameters"], tuple(changes)), strict=False
        )
        for key, section in _readers(point):
            if getattr(section, "file_digest", None) and section.file is None:  # type: ignore[attr-defined]
                msg = f"job {data['id']} starts from a file: name it in files[{dotted(key)}.file]"
                raise ValueError(msg)
        labels = tuple((block, scene) for block, scene in data.get("labels", ()))
        job = cls.create(point, data["seed"], data["replicate"], labels)
        if job.id != data["id"]:
            msg = f"the parameters of job {data['id']} were changed: they belong to job {job.id}"
            raise ValueError(msg)
        return job


@dataclass(frozen=True)
class StudyPoint:
    """One distinct point of a study; the labels of all blocks and scenes that ask for it."""

    id: str
    point: Point
    labels: Labels
    json: str = field(repr=False)  # canonical JSON of its parameters
    threads: int = 1  # that each of its jobs has use for, of those that the study asks for


@dataclass(frozen=True)
class Study:
    """A study file, read and validated.

    Attributes
    ----------
    name : str
        Stem of the file: names its results.
    path : Path
        The file.
    text : str
        The file as given.
    points : tuple of StudyPoint
        The distinct points, sorted by id.
    varied : tuple of str
        Dotted keys of the parameters that differ between points.
    files : tuple of Path
        Files that the study reads, relative to its folder.
    threads : int
        Cores that are asked for; a job uses as many of them as its point can.
    """

    name: str
    path: Path
    text: str = field(repr=False)
    seed: int
    replicates: int
    points: tuple[StudyPoint, ...] = field(repr=False)
    varied: tuple[str, ...]
    files: tuple[Path, ...] = ()
    threads: int = 1

    @property
    def kernels(self) -> str:
        """A name for all compiled code that the points of this study need."""
        return hashlib.sha256("".join(point.id for point in self.points).encode()).hexdigest()[:16]

    def jobs(self) -> list[Job]:
        """Return all jobs, sorted by id."""
        return sorted(
            (job for jobs in self.groups().values() for job in jobs), key=lambda job: job.id
        )

    def groups(self) -> dict[str, tuple[Job, ...]]:
        """Return the jobs of every point, by point id; replicates in order."""
        return {
            point.id: tuple(
                Job(
                    _job_id(point.point.kind, point.json, self.seed, replicate),
                    point.point,
                    self.seed,
                    replicate,
                    point.labels,
                    point.threads,
                )
                for replicate in range(self.replicates)
            )
            for point in self.points
        }


def load_study(path: Path | str) -> Study:
    """Read, validate and expand a study file.

    Parameters
    ----------
    path : Path or str
        YAML file; contact laws and start files are named relative to its folder.

    Raises
    ------
    StudyError
        With everything that is wrong, by line.
    """
    path = Path(path)
    try:
        content = path.read_bytes()
    except OSError as error:
        message = f"cannot be read ({error.strerror or error})"
        if path.is_dir():
            message = "a folder: give the study file, configs/<study>.yaml"
        raise StudyError(path, [Problem(path, None, "", NOTHING, message)]) from None
    return read_study(content, path)


def read_study(content: bytes, path: Path) -> Study:
    """Return the study that ``content`` describes, as if it stood in the file ``path``."""
    document = read_yaml(content, path)
    reader = _Reader(document)
    draft = reader.draft()
    design, points = draft.design, reader.points(draft)
    reader.check_threads(design.threads, points)
    reader.check_replicates(design.replicates, points)
    if reader.problems:
        raise StudyError(path, list(reader.problems.values()))
    return Study(
        name=path.stem,
        path=path,
        text=content.decode("utf-8-sig"),
        seed=design.seed,
        replicates=design.replicates,
        points=tuple(sorted(points, key=lambda point: point.id)),
        varied=tuple(_varied(list(reader.values.values()))),
        files=tuple(sorted(reader.files)),
        threads=design.threads,
    )


def parameters(point: Point) -> dict[str, Any]:
    """Return every resolved parameter of ``point``, JSON-ready, without paths of files."""
    return point.model_dump(mode="json", exclude=_paths(type(point)))


@cache
def _paths(section: type[BaseModel]) -> dict[str, Any]:
    """Return the fields named ``file`` of a section and those below, as pydantic excludes them."""
    found: dict[str, Any] = {"file": True} if "file" in section.model_fields else {}
    for name, info in section.model_fields.items():
        inner: dict[str, Any] = {}
        for option in sections_of(info.annotation):
            inner |= _paths(option)
        if inner:
            found[name] = inner
    return found


def _rounded(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: _rounded(item) for name, item in value.items()}
    return round12(value) if isinstance(value, float) else value


def _canonical(values: dict[str, Any]) -> str:
    """Return the one JSON text of ``values``: sorted keys, shortest floats."""
    return json.dumps(values, sort_keys=True, separators=(",", ":"), allow_nan=False)


def _job_id(kind: str, point: str, seed: int, replicate: int) -> str:
    """Return the id of a job; ``point`` is canonical JSON, and so is what is hashed."""
    version = models.model(kind).PHYSICS_VERSION
    text = (
        f'{{"kind":"{kind}","physics_version":{version},"point":{point},'
        f'"replicate":{replicate},"seed":{seed}}}'
    )
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def _point_id(kind: str, point: str) -> str:
    version = models.model(kind).PHYSICS_VERSION
    text = f'{{"kind":"{kind}","physics_version":{version},"point":{point}}}'
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def _readers(section: Section, key: Key = ()) -> Iterator[tuple[Key, Section]]:
    """Yield the key and the section of everything in ``section`` that may read a file."""
    fields = type(section).model_fields
    if "file" in fields:
        yield key, section
    for name in fields:
        value = getattr(section, name)
        if isinstance(value, Section):
            yield from _readers(value, (*key, name))


_ABSENT = object()


def _varied(points: Sequence[Any], key: str = "") -> Iterator[str]:
    """Yield the dotted keys whose values differ between ``points``."""
    if all(point == points[0] for point in points):
        return
    if not all(isinstance(point, dict) for point in points):
        yield key
        return
    for name in dict.fromkeys(name for point in points for name in point):
        values = [point.get(name, _ABSENT) for point in points]
        yield from _varied(values, f"{key}.{name}" if key else name)


class _Reader:
    """Turns one document into points, and collects what is wrong with it."""

    def __init__(self, document: Document) -> None:
        self.document = document
        self.problems: dict[tuple[object, ...], Problem] = {}
        self.files: set[Path] = set()
        self._content: dict[Path, bytes] = {}
        self.values: dict[str, dict[str, Any]] = {}  # parameters of the points, by their JSON
        # Most studies read no file, and looking for one at every point takes time.
        self._names_files = any(
            str(part).rsplit(".", 1)[-1] in {"file", "file_digest", "source"}
            for key in document.lines
            for part in key[-1:]
        )
        self._base = {name: v for name, v in document.data.items() if name not in KEYS}

    def draft(self) -> Draft:
        """Return the keys that are not sections of the model, as far as they are right."""
        draft = read_design({k: v for k, v in self.document.data.items() if k in KEYS})
        for complaint in draft.complaints:
            self._report(self._in_file(complaint), self.document.data)
        return draft

    def _in_file(self, complaint: Complaint) -> Complaint:
        """Return ``complaint`` with the keys of the file: a single block is not a list there."""
        if isinstance(self.document.data.get("sweep"), list):
            return complaint
        keys = tuple(
            (key[0], *key[2:]) if key[0] == "sweep" and len(key) > 1 else key
            for key in complaint.keys
        )
        return replace(complaint, keys=keys)

    def points(self, draft: Draft) -> list[StudyPoint]:
        """Return the distinct points of all blocks."""
        found: dict[str, StudyPoint] = {}
        unused = dict(draft.design.scenes)
        for variant in expand(draft, self.document.data.get("sweep")):
            if isinstance(variant, Complaint):
                self._report(variant, self.document.data)
                continue
            unused.pop(variant.label[1], None)
            point = self._point(variant.changes, complete=variant.complete)
            if point is None:
                continue
            values = parameters(point)
            key = _canonical(values)
            self.values[key] = values
            old = found.get(key)
            labels = (*old.labels, variant.label) if old else (variant.label,)
            labels = tuple(dict.fromkeys(labels))
            threads = draft.design.threads
            if threads > 1:
                threads = min(threads, models.model(point.kind).most_threads(point))
            found[key] = StudyPoint(_point_id(point.kind, key), point, labels, key, threads)
        # What no point has shown: scenes without a block, and the base of blocks that are wrong.
        for name, scene in unused.items():
            self._point(changes_of(scene, ("scenes", name)), complete=False)
        if self.problems:
            self._point((), complete=False)
        return list(found.values())

    def check_threads(self, threads: int, points: Sequence[StudyPoint]) -> None:
        """Report a study that asks for several cores a job, of which every job would use one."""
        if self.problems or threads == 1 or any(point.threads > 1 for point in points):
            return
        kinds = sorted({point.point.kind for point in points})
        rules = "; ".join(f"{kind}: {models.model(kind).THREADS}" for kind in kinds)
        message = (
            f"every job of this study can use 1 core only ({rules}): leave threads out, a sweep "
            "has a job on each core"
        )
        self._report(Complaint((("threads",),), message), self.document.data)

    def check_replicates(self, replicates: int, points: Sequence[StudyPoint]) -> None:
        """Report replicates of points that would be the same simulation again and again."""
        same = sum(not point.point.random for point in points)
        if self.problems or replicates == 1 or same == 0:
            return
        message = (
            f"nothing is random at {same} of {len(points)} points, whose "
            "replicates would be the same simulation again: replicates: 1, and others in a study "
            "of their own"
        )
        self._report(Complaint((("replicates",),), message), self.document.data)

    def _point(self, changes: Changes, *, complete: bool = True) -> Point | None:
        """Return the point that ``changes`` make of the base, or report and return None.

        With ``complete=False`` only faults of single values are reported: what a part of a study
        lacks, or what does not fit together in it, other parts may provide.
        """
        data = apply(self._base, changes)
        section = data.get("model")
        kind = section.get("kind", models.DEFAULT_KIND) if isinstance(section, dict) else None
        kind = models.DEFAULT_KIND if kind is None else kind
        if kind not in models.KINDS:
            complaint = Complaint((("model", "kind"),), one_of(kind, models.KINDS))
            self._report(complaint, data, changes)
            return None
        model = models.model(kind).POINT
        wrong_columns = list(_wrong_columns(data, kind))
        for complaint in wrong_columns:
            self._report(complaint, data, changes)
        try:
            point = model.model_validate(data)
            if self._names_files and (files := tuple(self._read_files(point))):
                point = model.model_validate(apply(data, files))
                point.check_files()
        except ValidationError as error:
            for complaint in all_complaints(error, model, data, KEYS):
                if complete or complaint.about != "whole":
                    self._report(complaint, data, changes)
        except Impossible as error:
            for keys, message in error.problems:
                complaint = Complaint(tuple(tuple(key.split(".")) for key in keys), message)
                self._report(complaint, data, changes)
        except _Fault as fault:
            self._report(fault.complaint, data, changes)
        else:
            return None if wrong_columns else point.resolved()
        return None

    def _read_files(self, point: Point) -> Iterator[Change]:
        """Yield absolute paths and contents of the files that ``point`` names."""
        for key, section in _readers(point):
            content = "source" if "source" in type(section).model_fields else "file_digest"
            if getattr(section, content) is not None:
                message = f"{content} is filled in when the study is read: write file: instead"
                raise _Fault(Complaint(((*key, content),), message))
            path: Path | None = getattr(section, "file")  # noqa: B009 - of any model
            if path is None:
                continue
            try:
                value = self._file(path, as_text=content == "source")
            except (OSError, ValueError) as error:
                reason = getattr(error, "strerror", None) or error
                message = f"cannot be read beside the study ({reason})"
                raise _Fault(Complaint(((*key, "file"),), message)) from None
            where = tuple(str(part) for part in key)
            yield Change((*where, "file"), (self.document.path.parent / path).absolute(), ())
            yield Change((*where, content), value, ())

    def _file(self, path: Path, *, as_text: bool) -> str:
        """Return the text of a file, or the SHA-256 of its bytes."""
        if path.is_absolute() or ".." in path.parts:
            msg = "name it relative to the study's folder, without .."
            raise ValueError(msg)
        if path not in self._content:
            self._content[path] = (self.document.path.parent / path).read_bytes()
            self.files.add(path)
        content = self._content[path]
        if as_text:
            return content.decode().replace("\r\n", "\n")
        return content_digest(path, content)

    def _report(self, complaint: Complaint, data: Mapping[str, Any], changes: Changes = ()) -> None:
        """Add a problem at the key that the study changes last, once for all points."""
        origins = [(key, _origin(key, changes)) for key in complaint.keys]
        written = [(key, key) for key in complaint.keys if key in self.document.lines]
        key, origin = next(
            ((key, origin) for key, origin in origins if origin is not None),
            (*written, (complaint.keys[0], complaint.keys[0]))[0],
        )
        line = self.document.line(origin)
        value: Any = data
        for part in key:
            try:
                value = value[part]
            except (KeyError, IndexError, TypeError):
                value = NOTHING
                break
        problem = Problem(self.document.path, line, dotted(key), value, complaint.message)
        # Of several wrong values each is told, of one wrong key or one misfit only the first.
        place = self._written(origin) if complaint.about == "value" else line
        same = (place, problem.key, re.sub(r"[\d.e+-]+", "#", complaint.message))
        self.problems.setdefault(same, problem)

    def _written(self, key: Key) -> Key:
        """Return ``key``, or of a value that the file does not hold the key that makes it."""
        while key and key not in self.document.lines:
            key = key[:-1]
        return key


class _Fault(Exception):  # noqa: N818 - never leaves this module
    def __init__(self, complaint: Complaint) -> None:
        self.complaint = complaint


def _wrong_columns(data: Mapping[str, Any], kind: str) -> Iterator[Complaint]:
    """Yield the columns that the model does not store, or that are named twice."""
    record = data.get("record")
    given = record.get("columns") if isinstance(record, dict) else None
    columns = given if isinstance(given, list) else []
    known = [column.name for column in models.model(kind).COLUMNS]
    for i, name in enumerate(columns):
        if not isinstance(name, str):
            continue  # its section says so
        if name not in known:
            message = f"{name} is no stored column: {one_of(name, known)}"
        elif name in columns[:i]:
            message = f"{name} is named twice"
        else:
            continue
        yield Complaint((("record", "columns", i),), message)


def _origin(key: Key, changes: Changes) -> Key | None:
    """Return where in the file ``key`` is changed, or None if it stands in the base."""
    for change in sorted(changes, key=lambda change: -len(change.key)):
        n = len(change.key)
        if key[:n] == change.key:
            return (*change.origin, *key[n:])
        if change.key[: len(key)] == key:
            return change.origin
    return None
