"""glTF's scene: which meshes stand where, instances and skins included."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from b23d.stages.geometry.gltf_document import Document
from b23d.stages.geometry.surface import MalformedError

DEEPEST = 10_000


@dataclass
class Placed:
    """A mesh where a node has it."""

    mesh: int
    node: dict[str, Any]
    name: str
    matrices: list[np.ndarray]
    """(4, 4) float64 mesh to world; one for each instance."""
    joints: np.ndarray | None
    """(j, 4, 4) float64 of a skinned mesh, in its bind pose: they take the place of the node's matrix."""


def placed_meshes(document: Document) -> list[Placed]:
    """Every mesh of the default scene, else of the first, else of all root nodes; by mesh, then by node's name.

    Raises MalformedError: an entry that does not exist, nodes in a circle.
    """
    world = _world(document)
    found = []
    for index, matrix in world.items():
        node = document.entry("nodes", index)
        if "mesh" not in node:
            continue
        joints = _joints(document, node["skin"]) if "skin" in node else None
        matrices = [matrix] if joints is not None else [matrix @ instance for instance in _instances(document, node)]
        found.append(Placed(node["mesh"], node, str(node.get("name", index)), matrices, joints))
    return sorted(found, key=lambda placed: (placed.mesh, placed.name))


def _world(document: Document) -> dict[int, np.ndarray]:
    """Node → its matrix to the world, of all nodes in the scene that are shown (KHR_node_visibility)."""
    world: dict[int, np.ndarray] = {}
    hidden: set[int] = set()
    local = _locals(document)
    waiting = [(root, np.eye(4)) for root in reversed(_roots(document))]
    while waiting:
        index, above = waiting.pop()
        node = document.entry("nodes", index)
        if index in world:
            raise MalformedError(f"node {index}: expected one place in the scene, got a second; export the shape again")
        world[index] = above @ local[index]
        if node.get("extensions", {}).get("KHR_node_visibility", {}).get("visible", True) is False:
            hidden.add(index)
        if index in hidden:
            hidden.update(node.get("children", []))
        waiting += [(child, world[index]) for child in reversed(node.get("children", []))]
    return {index: matrix for index, matrix in world.items() if index not in hidden}


def _roots(document: Document) -> list[int]:
    if document.tree.get("scenes"):
        return list(document.entry("scenes", document.tree.get("scene", 0)).get("nodes", []))
    nodes = document.tree.get("nodes", [])
    children = {child for node in nodes for child in node.get("children", [])}
    roots = [index for index in range(len(nodes)) if index not in children]
    if nodes and not roots:
        raise MalformedError("nodes: expected one that is no child, got a circle; export the shape again")
    return roots


def _locals(document: Document) -> np.ndarray:
    """Each node's matrix (n, 4, 4) to its parent: given, or translation · rotation · scale."""
    nodes = document.tree.get("nodes", [])
    parts = [np.array([node.get(key, default) for node in nodes], np.float64) for key, default in TRS.items()]
    matrices = _matrices(*parts) if nodes else np.zeros((0, 4, 4))
    for index, node in enumerate(nodes):
        if "matrix" in node:
            matrices[index] = np.array(node["matrix"], np.float64).reshape(4, 4).T
    if (wrong := np.flatnonzero(~np.isfinite(matrices).all(axis=(1, 2)))).size:
        raise MalformedError(f"node {wrong[0]}: expected a finite matrix, got another; export the shape again")
    return matrices


TRS = {"translation": [0, 0, 0], "rotation": [0, 0, 0, 1], "scale": [1, 1, 1]}
"""A node's place in parts, and what they are where absent."""


def _matrices(translation: np.ndarray, rotation: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """(n, 4, 4) of translations (n, 3), quaternions x y z w (n, 4) and scales (n, 3)."""
    x, y, z, w = (rotation / np.maximum(np.linalg.norm(rotation, axis=1, keepdims=True), 1e-30)).T
    turned = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )  # (3, 3, n)
    matrices = np.tile(np.eye(4), (len(translation), 1, 1))
    matrices[:, :3, :3] = np.moveaxis(turned, 2, 0) * scale[:, None, :]
    matrices[:, :3, 3] = translation
    return matrices


def _instances(document: Document, node: dict[str, Any]) -> list[np.ndarray]:
    """Where EXT_mesh_gpu_instancing repeats a node's mesh, relative to the node: (4, 4) each."""
    extension = node.get("extensions", {}).get("EXT_mesh_gpu_instancing")
    if extension is None:
        return [np.eye(4)]
    given = {key: document.floats(index) for key, index in extension.get("attributes", {}).items()}
    counts = {len(values) for key, values in given.items() if key.lower() in TRS}
    if len(counts) != 1:
        raise MalformedError(
            f"EXT_mesh_gpu_instancing: expected as many of each attribute, got {sorted(counts)}; export it again"
        )
    count = counts.pop()
    parts = [
        given.get(key.upper(), np.tile(np.array([default], np.float64), (count, 1))) for key, default in TRS.items()
    ]
    return list(_matrices(*parts))


def _joints(document: Document, index: int) -> np.ndarray:
    """A skin's joint matrices (j, 4, 4): from the mesh as bound to the world as the nodes stand."""
    skin = document.entry("skins", index)
    world = _world_of_all(document)
    joints = np.stack([world[joint] for joint in skin["joints"]])
    if "inverseBindMatrices" not in skin:
        return joints
    inverse = document.floats(skin["inverseBindMatrices"])[: len(joints)].reshape(-1, 4, 4).transpose(0, 2, 1)
    return np.einsum("jab,jbc->jac", joints, inverse)


def _world_of_all(document: Document) -> dict[int, np.ndarray]:
    """As `_world`, of all nodes, in the scene or not: a skeleton may stand beside it."""
    nodes = document.tree.get("nodes", [])
    parents = {child: i for i, node in enumerate(nodes) for child in node.get("children", [])}
    local = _locals(document)
    world: dict[int, np.ndarray] = {}
    for index in range(len(nodes)):
        chain = [index]
        while chain[-1] in parents and chain[-1] not in world and len(chain) < DEEPEST:
            chain.append(parents[chain[-1]])
        for at in reversed(chain):
            if at not in world:
                above = world[parents[at]] if parents.get(at) in world else np.eye(4)
                world[at] = above @ local[at]
    return world
