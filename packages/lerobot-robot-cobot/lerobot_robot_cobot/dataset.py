"""LeRobot's dataset from episodes that cobot has recorded (`python -m cobot.learning record`).

The service's distribution, cobot, must be installed too, because it reads the files.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from lerobot_robot_cobot.columns import OBSERVED, SUFFIX, WIDTH, observed

STATE, ACTION, IMAGES = "observation.state", "action", "observation.images."


def to_dataset(files: Sequence[Path], repo_id: str, root: Path, *, videos: bool = True) -> Any:
    """Make one dataset of all episodes, in order.

    Args:
        root: a folder that does not exist yet.
        videos: whether to store pictures as videos; if false, as single files.

    Returns:
        LeRobot's dataset.

    Raises:
        ValueError: there are no episodes, or a file does not match the others; the error names it.
        cobot.errors.InputError: a file is not an episode.
    """
    from lerobot.datasets.lerobot_dataset import LeRobotDataset

    from cobot.learning.episodes import read_episode

    if not files:
        raise ValueError("there is no episode")
    dataset: Any = None
    features: dict[str, Any] = {}
    rate_hz = 0.0
    for file in files:
        episode = read_episode(file)
        here = _features(episode, videos)
        if dataset is None:
            features, rate_hz = here, episode.rate_hz
            dataset = LeRobotDataset.create(
                repo_id=repo_id,
                fps=round(rate_hz),
                features=features,
                root=root,
                robot_type="cobot",
                use_videos=videos,
            )
        elif here != features or episode.rate_hz != rate_hz:
            raise ValueError(f"{file}: its joints, gripper, cameras or rate differ from those of {files[0]}")
        for index in range(len(episode.times_s)):
            frame: dict[str, Any] = {
                **_numbers(episode, index),
                "task": episode.about.get("task") or "no task was given",
            }
            for name, pictures in episode.pictures.items():
                frame[IMAGES + name] = pictures[index]
            dataset.add_frame(frame)
        dataset.save_episode()
    dataset.finalize()
    return dataset


def _numbers(episode: Any, index: int) -> dict[str, Any]:
    """Return the state and action of a frame: first the joints, then the gripper if the robot has one."""
    state, action = episode.position[index], episode.action[index]
    if episode.gripper:
        seen = episode.gripper[index]
        state = np.append(state, list(observed(seen).values()))
        action = np.append(action, seen.target_width)
    return {STATE: state.astype(np.float32), ACTION: action.astype(np.float32)}


def _features(episode: Any, videos: bool) -> dict[str, Any]:
    joints = [f"{name}{SUFFIX}" for name in episode.joint_names]
    state = [*joints, *OBSERVED] if episode.gripper else joints
    action = [*joints, WIDTH] if episode.gripper else joints
    pictures = {
        IMAGES + name: {
            "dtype": "video" if videos else "image",
            "shape": each.shape[1:],
            "names": ["height", "width", "channels"],
        }
        for name, each in episode.pictures.items()
    }
    numbers = {
        key: {"dtype": "float32", "shape": (len(names),), "names": names}
        for key, names in ((STATE, state), (ACTION, action))
    }
    return {**numbers, **pictures}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run `cobot-to-lerobot FOLDER EPISODE...`. Returns the exit status."""
    parser = argparse.ArgumentParser("cobot-to-lerobot", description=__doc__)
    parser.add_argument(
        "root", type=Path, metavar="FOLDER", help="folder of the dataset, which must not exist yet"
    )
    parser.add_argument("files", type=Path, nargs="+", metavar="EPISODE.mcap")
    parser.add_argument(
        "--repo-id", default="local/cobot", help="LeRobot's name of the dataset (%(default)s)"
    )
    parser.add_argument("--images", action="store_true", help="store single pictures instead of videos")
    chosen = parser.parse_args(arguments)
    try:
        dataset = to_dataset(chosen.files, chosen.repo_id, chosen.root, videos=not chosen.images)
    except Exception as exc:  # noqa: BLE001 - LeRobot's and ours, each a sentence for who called it
        print(f"cobot-to-lerobot: {exc}", file=sys.stderr)
        return 1
    print(f"{chosen.root}: {dataset.num_episodes} episodes, {dataset.num_frames} frames")
    return 0


if __name__ == "__main__":
    sys.exit(main())
