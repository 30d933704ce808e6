"""Reading of the datasets that `hypogeum demos` and `hypogeum.record` write."""

from __future__ import annotations

import io
import json
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, overload

import numpy as np
from numpy.typing import NDArray

STATE, ACTION, IMAGES = "observation.state", "action", "observation.images."
CAMERA = "_camera"


@dataclass(frozen=True)
class Demonstration:
    """An episode of a dataset."""

    task: str
    instruction: str
    episode: int
    """Index under the suite seed, with which `reset(options={"episode": ...})` starts the same episode."""
    fingerprint: str
    observations: dict[str, NDArray[Any]]
    """As an env's: `state`, `[n_steps, state_dim]` f32, and each camera's `[n_steps, height, width, 3]` u8."""
    actions: NDArray[np.float32]
    """The row executed after each observation, `[n_steps, action_dim]`."""

    def __len__(self) -> int:
        return len(self.actions)


class Demonstrations(Sequence[Demonstration]):
    """Episodes of a dataset, each read from the disk when it is asked for.

    Args:
        path: Folder of a dataset, such as `demos/single`.
        tasks: Names of tasks, or `None` for all.
        images: `True` for all cameras, names of some, or `False`. Only these are decoded.

    Attributes:
        settings: `meta/hypogeum.json`: `morphology`, `control_mode`, `perturbation`, `seed` and more.
        cameras: Names of the cameras that are read.

    Raises:
        FileNotFoundError: The folder has no such dataset.
        ValueError: The dataset has no such task or camera.
        ModuleNotFoundError: pyarrow or, with images, Pillow is not installed.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        tasks: str | Sequence[str] | None = None,
        images: bool | Sequence[str] = True,
    ) -> None:
        """See the class."""
        _require("pyarrow", "pyarrow")
        root = Path(path)
        if not (root / "meta/info.json").is_file():
            raise FileNotFoundError(
                f"{root} has no meta/info.json: expected a dataset of `hypogeum demos` or `hypogeum.record`, such as "
                "demos/single"
            )
        self.settings: dict[str, Any] = json.loads((root / "meta/hypogeum.json").read_text())
        features = json.loads((root / "meta/info.json").read_text())["features"]
        self._features = {camera_name(name): name for name in features if name.startswith(IMAGES)}
        wanted = list(self._features) if images is True else [] if images is False else images
        self.cameras = [wanted] if isinstance(wanted, str) else list(wanted)
        self._stored = stored_episodes(root)
        if tasks is not None:
            names = {tasks} if isinstance(tasks, str) else set(tasks)
            _require_known("task", names, {record["task"] for _, _, record in self._stored})
            self._stored = [it for it in self._stored if it[2]["task"] in names]
        _require_known("camera", self.cameras, self._features)
        if self.cameras:
            _require("PIL", "pillow")

    def __len__(self) -> int:
        return len(self._stored)

    @overload
    def __getitem__(self, index: int) -> Demonstration: ...
    @overload
    def __getitem__(self, index: slice) -> list[Demonstration]: ...
    def __getitem__(self, index: int | slice) -> Demonstration | list[Demonstration]:
        if isinstance(index, slice):
            return [self[i] for i in range(*index.indices(len(self)))]
        path, group, record = self._stored[index]
        from pyarrow import parquet

        columns = [STATE, ACTION, *(self._features[camera] for camera in self.cameras)]
        table = parquet.ParquetFile(path).read_row_group(group, columns=columns)
        observations: dict[str, NDArray[Any]] = {"state": _rows(table, STATE)}
        for camera in self.cameras:
            files = table.column(self._features[camera]).combine_chunks().field("bytes")
            observations[camera] = np.stack([_decode(file.as_buffer()) for file in files])
        names = {key: record[key] for key in ("task", "instruction", "fingerprint")}
        return Demonstration(**names, episode=record["index"], observations=observations, actions=_rows(table, ACTION))


def stored_episodes(root: Path) -> list[tuple[Path, int, dict[str, Any]]]:
    """Return of each episode its data file, its row group there, and its record in `meta/hypogeum.jsonl`."""
    lines = (root / "meta/hypogeum.jsonl").read_text().splitlines()
    files = zip(sorted(root.glob("data/*/*.parquet")), map(json.loads, lines))
    return [(path, group, record) for path, records in files for group, record in enumerate(records)]


def camera_name(feature: str) -> str:
    """Return the name of a camera in envs, of which a feature may have the first part only."""
    return feature.removeprefix(IMAGES).removesuffix(CAMERA) + CAMERA


def _rows(table: Any, name: str) -> NDArray[np.float32]:
    # A copy, because torch warns of arrays that it must not write.
    return np.array(table.column(name).combine_chunks().flatten(), np.float32).reshape(len(table), -1)


def _decode(file: Any) -> NDArray[np.uint8]:
    from PIL import Image

    return np.asarray(Image.open(io.BytesIO(file)))


def _require(module: str, distribution: str) -> None:
    from importlib.util import find_spec

    if find_spec(module) is None:
        raise ModuleNotFoundError(f"reading a dataset needs {distribution}: pip install {distribution}", name=module)


def _require_known(kind: str, names: Sequence[str] | set[str], known: Any) -> None:
    unknown = sorted(set(names) - set(known))
    if unknown:
        raise ValueError(f"the dataset has no {kind} {', '.join(unknown)}; it has {', '.join(sorted(known))}")
