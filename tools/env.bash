# Source this in terminals and scripts: the ROS of this machine, then the workspace if it is built.
workspace="$(CDPATH= cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)"
if [ -f /opt/ros/noetic/setup.bash ]; then source /opt/ros/noetic/setup.bash; fi
if [ -f "$workspace/devel/setup.bash" ]; then source "$workspace/devel/setup.bash"; fi
# ROS is for the system's python3; another one may come first on PATH (pyenv, conda), by which
# programs of ROS that begin with `env python3`, such as rostopic in a launch file, would not start.
export PATH="/usr/bin:$PATH:$workspace/build/hosts"
# rospy looks through all packages for it at each start.
logging="${ROS_ETC_DIR:-/etc/ros}/python_logging.conf"
if [ -f "$logging" ] && [ ! -d "${ROS_HOME:-$HOME/.ros}/config" ]; then export ROS_PYTHON_LOG_CONFIG_FILE="${ROS_PYTHON_LOG_CONFIG_FILE:-$logging}"; fi
unset workspace logging
