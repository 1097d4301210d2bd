#!/usr/bin/env bash
# Tests a farm on one machine: an S3 server, Open Job Description and Slurm, all on the loopback interface.
#
#   tests/farm/run.sh [--tier s3|folder] [--models N] [CASE..]
#
# It builds the command, installs what it needs from Debian and PyPI (as root, or with sudo), and runs the cases of farm.py:
# all of them, or those that are named. `FARM_COMMAND` names a command that is built already; with `--tier s3` it must have the
# feature `cloud`.
set -euo pipefail
here="$(cd "$(dirname "$0")" && pwd)"
root="$(cd "$here/../.." && pwd)"
tools="${FARM_TOOLS:-${XDG_CACHE_HOME:-$HOME/.cache}/simpliguard-farm}"

as_root() {
    if [ "$(id -u)" = 0 ]; then "$@"; else sudo -n "$@"; fi
}

if ! command -v slurmctld >/dev/null || ! command -v slurmd >/dev/null || ! command -v munged >/dev/null; then
    as_root env DEBIAN_FRONTEND=noninteractive apt-get install -y --no-install-recommends \
        slurmctld slurmd slurm-client munge
fi
if [ ! -x "$tools/bin/moto_server" ] || [ ! -x "$tools/bin/openjd" ]; then
    python3 -m venv "$tools"
    "$tools/bin/pip" install --quiet "moto[server]==5.2.5" "openjd-cli==0.8.0"
fi
if [ -z "${FARM_COMMAND:-}" ]; then
    cd "$root"
    cargo build --release --package simpliguard_cli --features cloud
    FARM_COMMAND="${CARGO_TARGET_DIR:-$root/target}/release/simpliguard"
fi
export FARM_COMMAND PATH="$tools/bin:$PATH"
exec "$tools/bin/python" "$here/farm.py" "$@"
