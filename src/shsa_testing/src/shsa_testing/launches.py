"""Launch files, read as roslaunch reads them."""
import os
import tempfile
from pathlib import Path
from unittest.mock import patch

import roslaunch


def loaded(file: Path, *arguments: str) -> roslaunch.ROSLaunchConfig:
    """Return what `roslaunch FILE ARGUMENTS` would start.

    Nobody asks for the version of ROS: that is two processes for each file.
    """
    with tempfile.TemporaryDirectory() as folder:
        os.symlink("/bin/true", os.path.join(folder, "rosversion"))
        with patch.dict(os.environ, {"PATH": f"{folder}:{os.environ['PATH']}"}):
            return roslaunch.config.load_config_default(
                [(str(file), list(arguments))], None, assign_machines=False
            )
