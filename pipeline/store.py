"""Store: artifacts as zarr v3 groups, published whole or not at all. The only module that imports zarr.

Layout: `<stage>/<ab>/<rest of the address>/`, one zarr group an artifact. The group's `zarr.json` holds the JSON
fields, a sha256 per array, the provenance and the arrays' metadata (consolidated). On a local disk the folder is
written aside, read back, and renamed; in an object store `zarr.json` is written last. Either way its presence means:
complete.

zarr reads a missing chunk as zeros, silently; every read here checks the array's digest instead.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import shutil
import time
import uuid
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import fsspec
import numpy as np
from fsspec.implementations.local import LocalFileSystem

from b23d.pipeline.errors import ArtifactNotFoundError, CorruptArtifactError
from b23d.pipeline.zarr_format import array_metadata, chunk_key, decode, encode, group_metadata
from b23d.schemas.artifact import Artifact

A = TypeVar("A", bound=Artifact)

HEAD = "zarr.json"
WRITING = ".writing"  # artifacts on their way; what is old there was left by a killed process


@dataclass(frozen=True)
class ArrayHead:
    """What is known of a stored array without reading it."""

    shape: tuple[int, ...]
    dtype: str
    sharded: bool
    sha256: str
    stored_bytes: int


@dataclass(frozen=True)
class Head:
    """What is known of an artifact without reading its arrays."""

    schema: str
    values: dict[str, Any]
    arrays: dict[str, ArrayHead]
    provenance: dict[str, Any]

    @property
    def stored_bytes(self) -> int:
        return sum(array.stored_bytes for array in self.arrays.values())


class Store:
    """Artifacts by (stage, address), on any file system fsspec knows; `root` is a path or a URL."""

    def __init__(self, root: str | Path) -> None:
        self.fs, self.root = fsspec.core.url_to_fs(str(root), auto_mkdir=True)
        self.url = str(root)
        self.local = isinstance(self.fs, LocalFileSystem)

    def check_writable(self) -> None:
        """Raises PermissionError, with what to do, where nothing can be written."""
        probe = f"{self.root}/{WRITING}/{uuid.uuid4().hex}"
        try:
            self.fs.makedirs(f"{self.root}/{WRITING}", exist_ok=True)
            self.fs.pipe_file(probe, b"")
            self.fs.rm_file(probe)
        except OSError as error:
            got = f"{self.url} ({error})"
            reason = f"store: expected a folder or URL that can be written, got {got}; give another with --store"
            raise PermissionError(reason) from error

    def path(self, stage: str, address: str) -> str:
        return f"{self.root}/{stage}/{address[:2]}/{address[2:]}"

    def addresses(self, stage: str) -> set[str]:
        """Addresses of all complete artifacts of a stage."""
        if self.local:
            return set(_scan(Path(self.root) / stage))
        entries = [(fan, rest) for fan in self._names(stage) for rest in self._names(f"{stage}/{fan}")]
        return {fan + rest for fan, rest in entries if self.fs.exists(f"{self.root}/{stage}/{fan}/{rest}/{HEAD}")}

    def stages(self) -> list[str]:
        """Stages that have artifacts."""
        return sorted(
            name for name in self._names("") if not name.startswith(".") and self.fs.isdir(f"{self.root}/{name}")
        )

    def has(self, stage: str, address: str) -> bool:
        return bool(self.fs.exists(f"{self.path(stage, address)}/{HEAD}"))

    def write(self, stage: str, address: str, artifact: Artifact, provenance: dict[str, Any]) -> int:
        """Publish an artifact, atomically; returns its stored bytes. Writing what is there already changes nothing.

        Raises CorruptArtifactError where what was written does not read back, OSError where it cannot be written.
        """
        files, head = _encode(artifact, provenance)
        final = self.path(stage, address)
        if self.local:
            self._publish_local(Path(final), files, head)
        else:
            for name, data in files.items():
                self.fs.pipe_file(f"{final}/{name}", data)
            self.fs.pipe_file(f"{final}/{HEAD}", head)
        return sum(map(len, files.values())) + len(head)

    def head(self, stage: str, address: str) -> Head:
        """Raises ArtifactNotFoundError where there is none, CorruptArtifactError where it is not readable JSON."""
        path = f"{self.path(stage, address)}/{HEAD}"
        try:
            attributes = json.loads(self.fs.cat_file(path))["attributes"]
            arrays = {name: ArrayHead(**{**a, "shape": tuple(a["shape"])}) for name, a in attributes["arrays"].items()}
            return Head(attributes["schema"], attributes["values"], arrays, attributes["provenance"])
        except FileNotFoundError as error:
            raise ArtifactNotFoundError(
                f"{stage}: expected an artifact at {address[:12]}, got nothing there; run it first"
            ) from error
        except (ValueError, KeyError, TypeError) as error:
            raise CorruptArtifactError(_corrupt(stage, address, HEAD, error)) from error

    def read(self, stage: str, address: str, schema: type[A]) -> A:
        """The artifact, each array read and checked against its digest when first touched."""
        head = self.head(stage, address)
        if head.schema != schema.__name__:
            raise TypeError(
                f"{stage} {address[:12]}: expected {schema.__name__}, got {head.schema}; check the run's feeds"
            )
        return schema.lazy(
            head.values, set(head.arrays), lambda name: self._array(stage, address, name, head.arrays[name])
        )

    def array(self, stage: str, address: str, name: str) -> np.ndarray:
        """One array. Raises CorruptArtifactError where it is not what was written."""
        return self._array(stage, address, name, self.head(stage, address).arrays[name])

    def damage(self, stage: str, address: str) -> list[str]:
        """What is wrong with an artifact, a line each; zarr itself reads it, and digests are compared."""
        import zarr

        try:
            head = self.head(stage, address)
            path = self.path(stage, address)
            group: Any = zarr.open_group(path if self.local else self.fs.unstrip_protocol(path), mode="r")
        except (OSError, ValueError) as error:
            return [str(error)]
        lines = []
        for name, array in head.arrays.items():
            try:
                if not self.fs.exists(f"{self.path(stage, address)}/{name}/{chunk_key(array.shape)}"):
                    lines.append(f"{name}: expected its chunk, got none")
                elif _digest(np.asarray(group[name][...])) != array.sha256:
                    lines.append(f"{name}: expected sha256 {array.sha256[:12]}, got other bytes")
            except Exception as error:  # zarr and its codecs raise their own kinds for damaged bytes
                lines.append(f"{name}: {type(error).__name__}: {error}")
        return lines

    def delete(self, stage: str, address: str) -> None:
        """Remove an artifact; its head first, so that it is never half there."""
        path = self.path(stage, address)
        with contextlib.suppress(FileNotFoundError):
            self.fs.rm_file(f"{path}/{HEAD}")
            self.fs.rm(path, recursive=True)

    def sweep(self, older_than: float = 3600.0) -> None:
        """Remove what killed processes left half written, when older than some seconds."""
        if self.local:
            for path in Path(self.root, WRITING).glob("*"):
                if time.time() - path.stat().st_mtime > older_than:
                    shutil.rmtree(path, ignore_errors=True)

    def _names(self, folder: str) -> list[str]:
        path = f"{self.root}/{folder}".rstrip("/")
        try:
            return [str(child).rstrip("/").rsplit("/", 1)[-1] for child in self.fs.ls(path, detail=False)]
        except FileNotFoundError:
            return []

    def _publish_local(self, final: Path, files: dict[str, bytes], head: bytes) -> None:
        aside = Path(self.root, WRITING, uuid.uuid4().hex)
        try:
            for name, data in {**files, HEAD: head}.items():
                path = aside / name
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_bytes(data)
                if path.read_bytes() != data:
                    raise CorruptArtifactError(f"{final}: {name} did not read back as written; check the disk")
            final.parent.mkdir(parents=True, exist_ok=True)
            try:
                aside.rename(final)
            except OSError:
                if not (final / HEAD).exists():  # not a rival's complete copy, but something broken: replace it
                    shutil.rmtree(final, ignore_errors=True)
                    aside.rename(final)
        finally:
            shutil.rmtree(aside, ignore_errors=True)

    def _array(self, stage: str, address: str, name: str, head: ArrayHead) -> np.ndarray:
        path = f"{self.path(stage, address)}/{name}/{chunk_key(head.shape)}"
        try:
            value = decode(self.fs.cat_file(path), head.shape, head.dtype, head.sharded)
        except (ValueError, RuntimeError, FileNotFoundError) as error:
            raise CorruptArtifactError(_corrupt(stage, address, name, error)) from error
        if _digest(value) != head.sha256:
            raise CorruptArtifactError(_corrupt(stage, address, name, "the sha256 differs"))
        return value


def _encode(artifact: Artifact, provenance: dict[str, Any]) -> tuple[dict[str, bytes], bytes]:
    files, arrays, metadata = {}, {}, {}
    specs = artifact.array_specs()
    for name, value in artifact.present_arrays().items():
        value = np.ascontiguousarray(value)
        sharded = specs[name].sharded and value.size > 0
        data = encode(value, sharded)
        metadata[name] = array_metadata(value.shape, value.dtype, sharded)
        files[f"{name}/{chunk_key(value.shape)}"] = data
        files[f"{name}/{HEAD}"] = json.dumps(metadata[name]).encode()
        arrays[name] = {
            "shape": value.shape,
            "dtype": value.dtype.name,
            "sharded": sharded,
            "sha256": _digest(value),
            "stored_bytes": len(data),
        }
    attributes = {
        "schema": type(artifact).__name__,
        "values": artifact.plain_fields(),
        "arrays": arrays,
        "provenance": provenance,
    }
    return files, json.dumps(group_metadata(attributes, metadata)).encode()


def _digest(array: np.ndarray) -> str:
    return hashlib.sha256(np.ascontiguousarray(array).reshape(-1).view(np.uint8).data).hexdigest()


def _scan(stage: Path) -> Iterator[str]:
    with contextlib.suppress(FileNotFoundError), os.scandir(stage) as fans:
        for fan in fans:
            with os.scandir(fan.path) as entries:
                yield from (fan.name + entry.name for entry in entries)


def _corrupt(stage: str, address: str, name: str, reason: object) -> str:
    where = f"{stage} {address[:12]}/{name}"
    return f"{where}: expected the bytes that were written, got damaged ones ({reason}); run `b23d verify`"
