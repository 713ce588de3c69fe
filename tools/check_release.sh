#!/usr/bin/env bash
# Builds sdist and wheel from what git tracks, checks both, installs the wheel in a fresh environment and runs it from an empty folder;
# what the sdist installs has to be the same files.  Leaves both in FOLDER, if one is given:  tools/check_release.sh [FOLDER]
set -euo pipefail
keep=${1:+$(mkdir -p "$1" && cd "$1" && pwd)}
cd "$(dirname "$0")/.."
export OMP_NUM_THREADS=1 MPLBACKEND=Agg
unset PYTHONPATH

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
mkdir "$work/source"
git ls-files -z | tar --null --files-from=- -c | tar -x -C "$work/source"

python3 -m venv "$work/tools"
"$work/tools/bin/pip" install -q build twine
"$work/tools/bin/python" -m build --outdir "$work/dist" "$work/source" >"$work/build.log" 2>&1 || { cat "$work/build.log"; exit 1; }
"$work/tools/bin/twine" check --strict "$work"/dist/*

python3 -m venv "$work/venv"
. "$work/venv/bin/activate"
pip install -q "$work"/dist/*.whl
pip check
pip install -q --no-deps --target "$work/from_sdist" "$work"/dist/*.tar.gz
mkdir "$work/empty"
cp examples/decks/in.dpd examples/01_dpd_fluid.py "$work/empty"
cd "$work/empty"
version=$(basename "$work"/dist/*.tar.gz .tar.gz)
installed=$(python - "${version#openmm_dpd-}" <<'EOF'
import sys
from importlib.metadata import version
from pathlib import Path
import openmm_dpd
assert openmm_dpd.__version__ == version("openmm-dpd") == sys.argv[1], (openmm_dpd.__version__, version("openmm-dpd"), sys.argv[1])
print(Path(openmm_dpd.__file__).parent)
EOF
)
echo "installed in $installed"
case $installed in "$work"/venv/*) ;; *) echo "that is not the fresh environment"; exit 1 ;; esac
diff -r -x __pycache__ "$installed" "$work/from_sdist/openmm_dpd"

openmm-dpd --help >help.txt
openmm-dpd run in.dpd --var nequil 100 --var nrun 200 --quiet --json report.json --out out
python 01_dpd_fluid.py
for name in help.txt report.json out/thermo.png fluid.dcd fluid.psf fluid.csv; do
    [ -s "$name" ] || { echo "$name was not written"; exit 1; }
done
if [ -n "$keep" ]; then cp "$work"/dist/* "$keep"; fi
echo "all done"
