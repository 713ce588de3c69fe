"""The pictures of docs/gallery.md: those that the examples and a deck draw, made small.

python docs/measure/gallery.py                     # all, a quarter of an hour
python docs/measure/gallery.py 04_two_fluids in.dpd
"""

from __future__ import annotations

import importlib.util
import sys
import tempfile
from pathlib import Path

from PIL import Image

ROOT = Path(__file__).resolve().parents[2]
OUT = ROOT / "docs" / "figures" / "gallery"
WIDTH, LARGEST = 800, 60_000  # pixels, bytes


def picture_of_example(name: str, folder: Path) -> Path:
    """Run an example; the one picture that it draws."""
    spec = importlib.util.spec_from_file_location(name, ROOT / "examples" / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    module.main(folder)
    (picture,) = folder.glob("*.png")
    return picture


def picture_of_deck(name: str, folder: Path) -> Path:
    """Run a deck; its curves."""
    from openmm_dpd.lammps import run_deck

    run_deck(str(ROOT / "examples" / "decks" / name), out=str(folder))
    return folder / "thermo.png"


def shrink(source: Path, target: Path) -> None:
    """At most WIDTH pixels wide, in as many colours as LARGEST bytes allow."""
    picture = Image.open(source).convert("RGB")
    if picture.width > WIDTH:
        picture = picture.resize((WIDTH, round(picture.height * WIDTH / picture.width)), Image.Resampling.LANCZOS)
    for colours in (256, 128, 64, 32, 16):
        picture.quantize(colours).save(target, optimize=True)
        if target.stat().st_size < LARGEST:
            return
    raise SystemExit(f"{target.name} has {target.stat().st_size} bytes in 16 colours")


def with_pictures() -> list[str]:
    """Examples that draw, and a deck."""
    scripts = sorted((ROOT / "examples").glob("[0-9]*.py"))
    return [path.stem for path in scripts if "savefig" in path.read_text(encoding="utf-8")] + ["in.dpd"]


if __name__ == "__main__":
    OUT.mkdir(exist_ok=True)
    for name in sys.argv[1:] or with_pictures():
        with tempfile.TemporaryDirectory() as folder:
            draw = picture_of_deck if name.startswith("in.") else picture_of_example
            shrink(draw(name, Path(folder)), OUT / f"{name}.png")
        print(name, (OUT / f"{name}.png").stat().st_size, flush=True)
