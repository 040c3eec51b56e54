"""What pyproject.toml cannot say: which modules are compiled, and how.

    python setup.py preflight            says in one sentence what the build lacks (needs nothing installed)
    python setup.py requirements         prints what pyproject.toml says the build needs
    python setup.py build_ext --inplace  compiles what has changed, beside the sources

With COBOT_SANITIZE=1 the modules report invalid memory accesses and undefined behaviour
(tests/test_sanitizers.py).
"""

from __future__ import annotations

import os
import shlex
import shutil
import sys
import sysconfig
from pathlib import Path


def preflight() -> str | None:
    """What is missing to compile, as a sentence; None if nothing is."""
    if compiler() is None:
        return "cobot needs a C compiler: install gcc or clang (Debian: apt-get install gcc), or set CC"
    if not Path(sysconfig.get_path("include"), "Python.h").exists():
        return (
            f"cobot needs the C headers of Python {sys.version_info[0]}.{sys.version_info[1]} "
            f"(Debian: apt-get install python3-dev): there is no Python.h in {sysconfig.get_path('include')}"
        )
    return None


def compiler() -> str | None:
    """The command of the C compiler: CC, or the one Python was built with, or the first that is found."""
    chosen = os.environ.get("CC")
    commands = [chosen] if chosen else [sysconfig.get_config_var("CC") or "cc", "gcc", "clang"]
    return next((command for command in commands if shutil.which(shlex.split(command)[0])), None)


def requirements() -> str:
    """One a line, for the lock file."""
    import tomllib

    return "\n".join(tomllib.loads(Path("pyproject.toml").read_text())["build-system"]["requires"])


if __name__ == "__main__" and sys.argv[1:] == ["preflight"]:
    sys.exit(preflight())
if __name__ == "__main__" and sys.argv[1:] == ["requirements"]:
    sys.exit(print(requirements()))

from importlib.util import find_spec  # noqa: E402

from setuptools import Extension, setup  # noqa: E402
from setuptools.command.build import build  # noqa: E402
from setuptools.command.build_ext import build_ext  # noqa: E402

PACKAGES = ("cobot", "rtloop", "app")
SANITIZE = bool(os.environ.get("COBOT_SANITIZE"))
GENERATED, MADE = Path("build", "cython"), Path("build", "sanitized" if SANITIZE else "compiled")
OWN_HEADERS = "cobot/robot"
# When one of them changes, everything is compiled anew.
SETTINGS = [name for name in ("setup.py", "requirements/build.lock") if Path(name).exists()]
PROCESSORS = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1

DIRECTIVES = {
    "language_level": 3,
    "boundscheck": False,
    "wraparound": False,
    "initializedcheck": False,
    "nonecheck": False,
    "cdivision": True,
    # Neither pickled nor introspected: a third less for the C compiler to do.
    "auto_pickle": False,
    "binding": False,
}
# A product and a sum stay two roundings, so that every processor computes the same figures. NaN and
# infinity keep their meaning: never -ffast-math.
ARITHMETIC = ["-fno-math-errno", "-ffp-contract=off"]
SANITIZERS = ["-fsanitize=address,undefined,float-cast-overflow", "-fno-sanitize-recover=all"]


def extension(source: Path) -> Extension:
    mujoco = find_spec("mujoco")
    headers = [str(Path(place, "include")) for place in (mujoco and mujoco.submodule_search_locations) or []]
    level = ["-O0", "-g1", "-fno-omit-frame-pointer", *SANITIZERS] if SANITIZE else ["-O2", "-g0"]
    return Extension(
        ".".join(source.with_suffix("").parts),
        [str(source)],
        include_dirs=[OWN_HEADERS, *headers],
        extra_compile_args=[*level, *ARITHMETIC],
        extra_link_args=SANITIZERS if SANITIZE else [],
    )


def own_headers(module: Extension) -> list[Path]:
    """The headers that a module may include: those of its package."""
    return sorted(Path(*module.name.split(".")[:-1]).glob("*.h"))


def settings_changed() -> float:
    return max(Path(name).stat().st_mtime for name in SETTINGS)


class Compile(build_ext):
    """Translates and compiles the modules that are older than what they are made of, on all processors.

    What it makes stays in MADE, from where it gets beside the sources, into an editable install or a wheel.
    """

    def finalize_options(self) -> None:
        super().finalize_options()
        self.parallel = self.parallel or PROCESSORS
        self.wanted_in, self.build_lib = self.build_lib, str(MADE)
        self.build_temp = str(MADE / "objects" / sys.implementation.cache_tag)  # of this Python alone

    def run(self) -> None:
        if self.inplace:
            self._remove_orphans()
        self._translate()
        super().run()
        self.build_lib = self.wanted_in
        if not self.inplace:
            for output in map(Path, self.get_outputs()):
                output.parent.mkdir(parents=True, exist_ok=True)
                self.copy_file(str(MADE / output.relative_to(self.build_lib)), str(output))

    def _translate(self) -> None:
        from Cython.Build import cythonize
        from Cython.Build.Dependencies import create_dependency_tree
        from Cython.Compiler.Errors import CompileError

        for generated in GENERATED.rglob("*.c"):  # They may have been translated with other settings.
            if generated.stat().st_mtime < settings_changed():
                generated.unlink()
        tree = create_dependency_tree()
        stale = sum(self.force or self._is_stale(each, tree) for each in self.extensions)
        if stale:
            if lacking := preflight():
                sys.exit(lacking)
            print(f"cobot: compiling {stale} of {len(self.extensions)} modules", flush=True)
        try:
            translated = cythonize(
                self.extensions,
                nthreads=min(PROCESSORS, stale),
                build_dir=str(GENERATED),
                compiler_directives=DIRECTIVES,
                force=self.force,
                quiet=True,
            )
        except CompileError as error:  # Cython has said where and why.
            sys.exit(f"cobot: {error} does not compile")
        for each, into in zip(self.extensions, translated, strict=True):
            each.sources, each.depends = into.sources, [*SETTINGS, *map(str, own_headers(each))]

    def _is_stale(self, each: Extension, tree) -> bool:
        *package, module = each.name.split(".")
        made = Path(self.build_lib, *package, self.get_ext_filename(module))
        newest = max(tree.newest_dependency(each.sources[0])[0], settings_changed())
        newest = max([newest, *(header.stat().st_mtime for header in own_headers(each))])
        return not made.exists() or made.stat().st_mtime < newest

    def _remove_orphans(self) -> None:
        """A compiled module whose source is gone would still be imported, before a .py file of its name."""
        suffix = sysconfig.get_config_var("EXT_SUFFIX")
        for package in PACKAGES:
            for compiled in Path(package).rglob("*" + suffix):
                if not compiled.with_name(compiled.name.removesuffix(suffix) + ".pyx").exists():
                    compiled.unlink()


class Build(build):
    """A wheel is made from nothing: what an earlier one left in build/lib would get into this one."""

    def run(self) -> None:
        shutil.rmtree(self.build_lib, ignore_errors=True)
        super().run()


if __name__ == "__main__":
    if not os.environ.get("CC") and (found := compiler()):
        os.environ["CC"] = found
    sources = sorted(source for package in PACKAGES for source in Path(package).rglob("*.pyx"))
    commands = {"build": Build, "build_ext": Compile}
    setup(ext_modules=[extension(source) for source in sources], cmdclass=commands)
