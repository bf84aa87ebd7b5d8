"""Builds the Python types of the ROS 2 packages without wheels.

They are tf2_msgs, vision_msgs and apriltag_msgs. `make test` runs it with the Python of the ROS wheels. ROS's own
generators write C from our definitions; gcc makes one extension module of each package. ROS computes the hashes of
these types itself.
"""

import os
import shutil
import subprocess
import sys
import sysconfig
from importlib import import_module
from pathlib import Path
from typing import Any, Final

import numpy as np

from onboard.wire.ros.types import DEFINITIONS

PREFIX: Final = Path(sys.prefix)
PACKAGES: Final = {"tf2_msgs": {"TFMessage": "geometry_msgs/TransformStamped[] transforms\n"}, **DEFINITIONS}
FASTRTPS: Final = {"typesupport_implementations": ["rosidl_typesupport_fastrtps_c"]}
GENERATORS: Final[tuple[tuple[str, str, dict[str, Any]], ...]] = (  # module, class, arguments
    ("rosidl_generator_c.cli", "GenerateC", {}),
    ("rosidl_typesupport_c.cli", "GenerateCTypesupport", FASTRTPS),
    ("rosidl_typesupport_fastrtps_c.cli", "GenerateFastRTPSCTypesupport", {}),
    ("rosidl_generator_py.cli", "GeneratePython", {"typesupport_implementations": ["rosidl_typesupport_c"]}),
)
MANIFEST: Final = (
    '<package format="3"><name>{}</name><version>0.0.0</version><description>x</description>'
    '<maintainer email="x@example.org">x</maintainer><license>x</license></package>'
)
PARTS: Final = (
    "rosidl_generator_c",
    "rosidl_generator_py",
    "rosidl_typesupport_c",
    "rosidl_typesupport_fastrtps_c",
)
LIBRARIES: Final = (
    *("fastcdr", "rmw", "rcutils", "rosidl_runtime_c"),
    *("rosidl_typesupport_c", "rosidl_typesupport_fastrtps_c", "rosidl_typesupport_fastrtps_cpp"),
)


def build(package: str, target: Path, work: Path) -> None:
    """Write a package into `target`."""
    from rosidl_adapter.msg import convert_msg_to_idl  # noqa: PLC0415 - where ROS is
    from rosidl_cli.command.hash.api import generate_type_hashes  # noqa: PLC0415

    folder = work / package
    (folder / "msg").mkdir(parents=True)
    (folder / "package.xml").write_text(MANIFEST.format(package), encoding="utf-8")
    for name, text in PACKAGES[package].items():
        (folder / "msg" / f"{name}.msg").write_text(text, encoding="utf-8")
        convert_msg_to_idl(folder, package, Path("msg") / f"{name}.msg", folder / "msg")
    common = {
        "package_name": package,
        "interface_files": [f"{folder}:msg/{name}.idl" for name in PACKAGES[package]],
        "include_paths": [PREFIX / "share"],
    }
    generate_type_hashes(**common, output_path=folder)
    for module, name, arguments in GENERATORS:
        hashes = [str(folder / "msg" / f"{one}.json") for one in PACKAGES[package]]
        more = {"type_description_files": hashes} if name == "GenerateC" else {}
        generator = getattr(import_module(module), name)(name, **arguments)
        generator.generate(**common, output_path=target / package, **more)
    compile_package(package, target)


def compile_package(package: str, target: Path) -> None:
    """One extension module of all sources of a package."""
    out, lib = target / package, PREFIX / "lib"
    python = sysconfig.get_path("include")
    folders = [*(PREFIX / "include").iterdir(), PREFIX / "include", target, Path(np.get_include()), python]
    includes = [f"-I{folder}" for folder in folders]
    sources = [path for path in out.rglob("*") if path.suffix in (".c", ".cpp")]
    objects = [path.with_name(f"{path.name}.o") for path in sources]
    for source, made in zip(sources, objects, strict=True):
        compiler = ["g++", "-std=c++17"] if source.suffix == ".cpp" else ["gcc", "-std=gnu11"]
        subprocess.run([*compiler, "-w", "-O0", "-fPIC", "-c", source, "-o", made, *includes], check=True)
    needed = [path for part in PARTS for path in lib.glob(f"lib*__{part}.so")]
    needed += [lib / f"lib{name}.so" for name in LIBRARIES]
    module = out / f"{package}_s__rosidl_typesupport_c{sysconfig.get_config_var('EXT_SUFFIX')}"
    subprocess.run(["g++", "-shared", "-o", module, *objects, "-Wl,--as-needed", *needed], check=True)
    (out / "__init__.py").touch()


if __name__ == "__main__":
    os.environ["AMENT_PREFIX_PATH"] = str(PREFIX)
    site_packages, build_folder = Path(sysconfig.get_path("purelib")), PREFIX / "build"
    shutil.rmtree(build_folder, ignore_errors=True)
    for package in PACKAGES:
        shutil.rmtree(site_packages / package, ignore_errors=True)
        build(package, site_packages, build_folder)
