"""Where an encoder's weights lie, and their digests: all that planning needs, without torch or transformers."""

from __future__ import annotations

import hashlib
import json
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from importlib.util import find_spec
from pathlib import Path

from b23d.stages.encoders.names import Package, family_of, packaged

SAFETENSORS, INDEX, TORCH = "model.safetensors", "model.safetensors.index.json", "pytorch_model.bin"
CONFIG, PREPROCESSOR = "config.json", "preprocessor_config.json"
WANTED = [CONFIG, PREPROCESSOR, SAFETENSORS, INDEX, "model-*-of-*.safetensors"]
"""Files asked of the hub. `pytorch_model.bin` only where a repository has no safetensors."""


@dataclass(frozen=True)
class Checkpoint:
    """An encoder's files on this machine.

    `path` is the one file of an embedded encoder, or a folder in transformers' format: config.json, the weights, and
    preprocessor_config.json if there is one.
    """

    encoder: str
    path: Path
    weights: tuple[Path, ...]
    """Files that hold tensors: one, or the shards in order."""
    configs: tuple[Path, ...] = ()

    def digests(self) -> dict[str, str]:
        """`weights`: sha256 of the weights' file as the hub shows it (of `sha256sum`'s lines for several shards);
        `config`: the same over config.json and preprocessor_config.json, for a folder."""
        digests = {"weights": _sha256_of_all(self.weights)}
        return digests | {"config": _sha256_of_all(self.configs)} if self.configs else digests


def find_checkpoint(encoder: str, folder: Path | None = None, sha256: str | None = None) -> Checkpoint:
    """Find an encoder's files, download them from the hub if they are nowhere, and check their digest.

    `encoder` as `names.known_name` gives it; `folder`: a local checkpoint, used in place of the hub's; `sha256`: what
    the weights' digest must be (an embedded encoder's is pinned besides).

    Raises FileNotFoundError where files are missing, ValueError where the digest is another or the folder holds another
    family's checkpoint.
    """
    if (package := packaged(encoder)) is not None:
        checkpoint = _embedded(encoder, package, folder)
        _expect(checkpoint, package.sha256, f"the package was changed; run `{package.install}` again")
    else:
        checkpoint = _in_folder(encoder, folder) if folder is not None else _from_hub(encoder)
        _expect_family(checkpoint)
    if sha256 is not None:
        _expect(checkpoint, sha256.lower(), "give the right checkpoint, or correct stages.extract.weights_sha256")
    return checkpoint


def read_json(path: Path) -> dict:
    """A JSON object. Raises ValueError, naming the file, where it is none."""
    try:
        value = json.loads(path.read_bytes())
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{path}: expected JSON, got {error}; fetch the file again") from error
    if not isinstance(value, dict):
        raise ValueError(f"{path}: expected a JSON object, got {type(value).__name__}; fetch the file again")
    return value


def _embedded(encoder: str, entry: Package, folder: Path | None) -> Checkpoint:
    if folder is not None:
        raise ValueError(
            f"encoder {encoder}: expected no stages.extract.weights (a package holds them), got {folder}; remove it"
        )
    for needed in (entry.package, *entry.needs):
        if find_spec(needed) is None:
            raise FileNotFoundError(
                f"encoder {encoder}: expected the package {needed}, got none installed; run `{entry.install}`"
            )
    spec = find_spec(entry.package)
    places = list(spec.submodule_search_locations or []) if spec else []
    for place in places:
        if (file := Path(place) / entry.file).is_file():
            return Checkpoint(encoder, file, (file,))
    raise FileNotFoundError(
        f"encoder {encoder}: expected {entry.file} in {' or '.join(places)}, got no such file; run `{entry.install}`"
    )


def _in_folder(encoder: str, folder: Path) -> Checkpoint:
    def missing(what: str) -> FileNotFoundError:
        return FileNotFoundError(
            f"encoder {encoder}: expected {what} in {folder}, got none; give a checkpoint in transformers' format"
        )

    if not folder.is_dir():
        raise FileNotFoundError(
            f"encoder {encoder}: expected stages.extract.weights to be a folder, got {folder}; correct the path"
        )
    if not (folder / CONFIG).is_file():
        raise missing(CONFIG)
    configs = tuple(path for name in (CONFIG, PREPROCESSOR) if (path := folder / name).is_file())
    weights: tuple[Path, ...]
    if (folder / SAFETENSORS).is_file():
        weights = (folder / SAFETENSORS,)
    elif (folder / INDEX).is_file():
        weights = tuple(folder / name for name in _shards(folder / INDEX))
    elif (folder / TORCH).is_file():
        weights = (folder / TORCH,)
    else:
        raise missing(f"{SAFETENSORS} (or its shards, or {TORCH})")
    for shard in weights:
        if not shard.is_file():
            raise missing(shard.name)
    return Checkpoint(encoder, folder, weights, configs)


def _shards(index: Path) -> list[str]:
    """The files that an index spreads the weights over, sorted."""
    weight_map = read_json(index).get("weight_map")
    names = weight_map.values() if isinstance(weight_map, dict) else [None]
    if not names or not all(isinstance(name, str) and name and "\0" not in name for name in names):
        raise ValueError(
            f"{index}: expected weight_map to give the file of every weight, got {str(weight_map)[:80]}; "
            "restore the checkpoint"
        )
    return sorted(set(names))


def _from_hub(encoder: str) -> Checkpoint:
    """From the hub's cache; what is not there, or not completely, is downloaded into it."""
    from huggingface_hub import snapshot_download, try_to_load_from_cache

    family = family_of(encoder)
    hub = encoder if family is None else family.hub[encoder]
    try:
        if isinstance(cached := try_to_load_from_cache(hub, CONFIG), str):
            with suppress(FileNotFoundError):
                return _in_folder(encoder, Path(cached).parent)
        folder = Path(snapshot_download(hub, allow_patterns=WANTED))
        if not any((folder / name).is_file() for name in (SAFETENSORS, INDEX)):
            folder = Path(snapshot_download(hub, allow_patterns=[*WANTED, TORCH]))
    except (
        OSError,
        ValueError,
    ) as error:  # no network, no such repository, no access, disk full: the hub's errors are these
        reason = str(error).strip().splitlines()[0] if str(error).strip() else type(error).__name__
        raise FileNotFoundError(
            f"encoder {encoder}: expected its weights in the hub's cache or a folder given by stages.extract.weights, "
            f"got neither, and the hub cannot be reached or does not give {hub} ({reason}); download it where there is "
            "a network, or take efficientnet-lite0"
        ) from error
    return _in_folder(encoder, folder)


def _expect(checkpoint: Checkpoint, sha256: str, remedy: str) -> None:
    got = checkpoint.digests()["weights"]
    if got != sha256:
        raise ValueError(
            f"encoder {checkpoint.encoder}: expected weights of sha256 {sha256}, got {got} in {checkpoint.path}; "
            f"{remedy}"
        )


def _expect_family(checkpoint: Checkpoint) -> None:
    if (family := family_of(checkpoint.encoder)) is not None:
        got = read_json(checkpoint.configs[0]).get("model_type")
        if got not in family.model_type:
            raise ValueError(
                f"encoder {checkpoint.encoder}: expected a checkpoint of model_type {' or '.join(family.model_type)}, "
                f"got {got} in {checkpoint.path}; give the checkpoint of this encoder, or its own hub name as "
                "stages.extract.encoder"
            )


def _sha256_of_all(files: tuple[Path, ...]) -> str:
    digests = [_sha256(str(file), (stat := file.stat()).st_size, stat.st_mtime_ns) for file in files]
    if len(digests) == 1:
        return digests[0]
    lines = "".join(f"{digest}  {file.name}\n" for digest, file in zip(digests, files, strict=True))
    return hashlib.sha256(lines.encode()).hexdigest()


@cache
def _sha256(path: str, size: int, mtime_ns: int) -> str:
    """Of a file's bytes; read once a process as long as its size and time of change stay."""
    with Path(path).open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
