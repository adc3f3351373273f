"""Ship ``examples/`` as ``printctl/examples``, and the commit; all else is in pyproject.toml."""

import subprocess
from pathlib import Path

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

    def run(self) -> None:
        """Keep the commit beside the code; an sdist brings the file, a checkout asks git."""
        super().run()
        kept = Path(self.build_lib, "printctl", "build.txt")
        if self.editable_mode or kept.exists() or not Path(".git").exists():
            return
        describe = ("git", "describe", "--always", "--dirty", "--exclude=*")
        done = subprocess.run(describe, capture_output=True, text=True, check=False)
        if done.returncode == 0:
            kept.write_text(done.stdout, encoding="utf-8")


setup(cmdclass={"build_py": BuildWithExamples})
