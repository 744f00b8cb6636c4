"""Makes a campaign folder that needs nothing outside itself."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from etude.campaign.config_file import CONFIG, config_text, load_config
from etude.campaign.folder import Campaign, open_campaign
from etude.campaign.journal import commit, read_events
from etude.campaign.presets import preset
from etude.campaign.robot_copy import copy_robot, robot_from
from etude.errors import UsageError
from etude.storage import write_atomic, writer_lock
from etude.trajectories.family import suited_to


def create_campaign(
    path: Path, robot: str, preset_name: str = "default", seed: int = 0
) -> tuple[Campaign, tuple[str, ...]]:
    """Makes the folder: robot.toml, the robot's model file, campaign.toml, and the journal's first event.

    Args:
        path: the folder; made if missing.
        robot: a built-in robot's name, or the path of a robot TOML, a URDF or an MJCF.
        preset_name: "default" or "thesis"; written out in full.
        seed: of every random number the campaign draws.

    Returns:
        the campaign, and one sentence for each limit that a person should confirm.

    Raises:
        UsageError: there is a campaign already, no folder can be made there, or the robot is unknown or
            impossible.
    """
    path = Path(path)
    spec, confirm = robot_from(robot)
    flying = spec.flight is not None
    start = preset(preset_name, flying=flying)
    trajectory = start.trajectory if flying else suited_to(start.trajectory, spec)
    config = replace(start, seed=seed, trajectory=trajectory)
    _make_folder(path)
    with writer_lock(path):
        if read_events(path):
            raise UsageError(
                "there is a campaign here already", where=str(path), next_step="Name another folder."
            )
        files = copy_robot(path, spec, confirm)
        write_atomic(path / CONFIG, config_text(config).encode())
        _, digest = load_config(path)
        facts = {"seed": seed, "preset": preset_name, "robot": spec.name, "axes": list(spec.names)}
        # campaign.toml is not listed: people may edit it, and its hash is in every event anyway
        commit(path, "created", None, digest, files, **facts)
    return open_campaign(path), confirm


def _make_folder(path: Path) -> None:
    try:
        path.mkdir(parents=True, exist_ok=True)
    except (FileExistsError, NotADirectoryError):
        raise UsageError(
            "this is a file, not a folder, or below one",
            where=str(path),
            next_step="Name another folder.",
        ) from None
    except OSError as error:
        raise UsageError(
            f"the folder cannot be made: {error.strerror or error}",
            where=str(path),
            next_step="Name another folder, or one above it that you may write to.",
        ) from None
