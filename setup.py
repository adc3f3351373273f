"""Ship ``examples/`` in the package as ``printctl/examples``; all else is in pyproject.toml."""

from setuptools import setup
from setuptools.command.build_py import build_py

EXAMPLES = "printctl.examples"


class BuildWithExamples(build_py):
    """Build whose packages have one more, that lies beside them in the sources."""

    def finalize_options(self) -> None:
        """Add the package, which an editable install reads where it lies."""
        packages = self.distribution.packages
        if not self.editable_mode and EXAMPLES not in packages:
            packages.append(EXAMPLES)
            self.distribution.package_dir[EXAMPLES] = "examples"
        super().finalize_options()


setup(cmdclass={"build_py": BuildWithExamples})
