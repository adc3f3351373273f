"""Ship ``examples/`` in the package as ``printctl/examples``; all else is in pyproject.toml."""

from setuptools import setup
from setuptools.command.build_py import build_py

EXAMPLES = "printctl.examples"


class BuildWithExamples(build_py):
    """Build with one package more, which lies beside the others in the sources."""

    def finalize_options(self) -> None:
        """Add it here alone: an editable install reads the examples where they lie."""
        super().finalize_options()
        self.packages = [*self.packages, EXAMPLES]
        self.package_dir[EXAMPLES] = "examples"


setup(cmdclass={"build_py": BuildWithExamples})
