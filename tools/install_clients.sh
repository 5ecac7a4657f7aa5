#!/usr/bin/env bash
# Client programs for the vehicle's tests, each in an environment of its own, because their needs clash.
#   tools/install_clients.sh [DIR]      default .clients; tests look there, or where SITL_CLIENTS points
set -euo pipefail

top=$(cd "$(dirname "$0")/.." && pwd)
to=${1:-$top/.clients}
python=${PYTHON:-python3.11}

install() {
  [ -x "$to/$1/bin/python" ] || "$python" -m venv "$to/$1"
  "$to/$1/bin/pip" install -q "${@:2}" || echo "$1 could not be installed: its tests skip with the reason"
}

mkdir -p "$to"
install mavsdk4 'mavsdk>=4.1,<5'
install mavsdk3 'mavsdk>=3.17,<4'
install mavproxy 'MAVProxy>=1.8.75' setuptools
install rotorpy rotorpy
