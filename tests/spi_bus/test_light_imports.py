"""What firmware and small tools import starts fast: the link and its codecs bring nothing heavy."""

from __future__ import annotations

import subprocess
import sys

HEAVY = ("numba", "llvmlite", "numpy", "scipy", "matplotlib", "can", "serial", "rich", "msgspec")


def test_the_link_imports_no_heavy_package():
    program = (
        "import sys, spi_bus.link\n"
        f"print([name for name in {HEAVY!r} if name in sys.modules])\n"
        "print(sorted(name for name in sys.modules if name.startswith('spi_bus')))"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    heavy, ours = done.stdout.splitlines()
    assert heavy == "[]"
    assert "transports" not in ours
