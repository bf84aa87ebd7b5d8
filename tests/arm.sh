#!/usr/bin/env bash
# Tests on an emulated ARM processor: `make arm`, or
#     bash tests/arm.sh FOLDER TEST...
# It takes Debian's Python for arm64 and the pinned wheels for aarch64 into FOLDER, installs nothing into the system,
# and runs the tests there by QEMU's user mode, kernels in Python. Then it replays a simulated flight with kernels
# compiled for ARMv8, as a wheel for aarch64 has them, and compares the estimates with this computer's own.
# Half an hour on one core; what is there already is taken again.
set -euo pipefail
cd "$(dirname "$0")/.."
folder=$(mkdir -p "$1" && cd "$1" && pwd)
shift
here=${PYTHON:-.venv/bin/python}

for tool in qemu-aarch64-static aarch64-linux-gnu-gcc apt-get dpkg-deb; do
    command -v "$tool" > /dev/null || {
        echo "$tool is missing; on Debian and Ubuntu: apt install qemu-user-static gcc-aarch64-linux-gnu" >&2
        exit 1
    }
done

if [ ! -x "$folder/root/usr/bin/python3.11" ]; then
    echo "fetching Debian's Python for arm64"
    mkdir -p "$folder"/apt/{state/lists/partial,cache/archives/partial} "$folder/root"
    : > "$folder/apt/status"
    apt=(apt-get -qq -o "Dir::State=$folder/apt/state" -o "Dir::State::status=$folder/apt/status"
        -o "Dir::Cache=$folder/apt/cache" -o APT::Architecture=arm64 -o APT::Architectures::=arm64
        -o APT::Install-Recommends=0 -o Debug::NoLocking=1)
    "${apt[@]}" update
    "${apt[@]}" -y --download-only install python3.11 python3.11-distutils libstdc++6 libgomp1
    for package in "$folder"/apt/cache/archives/*.deb; do dpkg-deb -x "$package" "$folder/root"; done
fi

needed=$("$here" -c 'import tomllib; print(*(r.replace(" ", "") for r in tomllib.load(open("pyproject.toml", "rb"))["project"]["dependencies"]))')
needed="$needed numba pytest pytest-timeout hypothesis matplotlib psutil setuptools" # and what the tests import
if [ "$(cat "$folder/site/.ready" 2> /dev/null)" != "$needed" ]; then
    echo "fetching wheels for aarch64"
    platforms=()
    for glibc in 2_28 2_27 2_26 2_24 2_17 2014; do platforms+=(--platform "manylinux_${glibc}_aarch64" --platform "manylinux${glibc}_aarch64"); done
    # shellcheck disable=SC2086  # a word each
    "$here" -m pip install -qq --no-compile --upgrade --target "$folder/site" "${platforms[@]}" --python-version 3.11 \
        --implementation cp --abi cp311 --abi abi3 --abi none --only-binary=:all: -c constraints.txt $needed
    echo "$needed" > "$folder/site/.ready"
fi

arm=$folder/python # its own children find it as sys.executable
printf '#!/bin/sh\nexec qemu-aarch64-static -0 %q -L %q %q "$@"\n' \
    "$arm" "$folder/root" "$folder/root/usr/bin/python3.11" > "$arm"
chmod +x "$arm"
export PYTHONPATH="$PWD:$folder/site"
"$arm" -c 'import platform; print(platform.machine(), platform.python_version())'

if [ $# -gt 0 ]; then
    # Not here: whole flights with kernels in Python, a quarter of an hour each (the replay below flies instead), and
    # what needs the kernel's stamps and counts of dropped datagrams, which QEMU's user mode does not pass on.
    WINGLINE_KERNELS=python "$arm" -m pytest -m "not slow" -p no:cacheprovider "$@" \
        -k "not (at_the_bounds_estimates or stamped_at_arrival or kernel_drops_is_counted)"
fi

# Compiling takes half an hour here. The compiler runs on this processor, for the other.
log=$folder/flight.tlog flies=('estimator={leader={size_prior_m=2.667,leader_class="multirotor",center_on_wing=true}}'
    'camera={f_px=554.256,width_px=640,height_px=480,mount_rpy_deg=[0,8,0]}')
PYTHONPATH=$PWD "$here" -m simlink log mission --seed 1 --duration 20 --out "$log"
CC=aarch64-linux-gnu-gcc "$arm" -m onboard.compiled
"$arm" -m onboard replay "$log" --set "${flies[0]}" --set "${flies[1]}" --out "$folder/replayed.csv"
"$arm" -m tests.support.exact_estimates "$log" "$folder/arm.csv" "${flies[@]}"
PYTHONPATH=$PWD "$here" -m tests.support.exact_estimates "$log" "$folder/here.csv" "${flies[@]}"
PYTHONPATH=$PWD "$here" -m tests.support.same_estimates "$folder/here.csv" "$folder/arm.csv"
