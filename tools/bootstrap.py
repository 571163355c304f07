"""Set-up in one command: an environment, the pinned packages, then the run or the tests.

Runs on a bare Python 3.11 with nothing but the standard library. The environment (`.venv`) is kept
and used again as long as `pyproject.toml` and `constraints.txt` stay what they were: a stamp file
inside it holds their hash for what is installed, written last, so that a half-made environment is
made again. The test packages go on top of an environment for runs.

    python3 tools/bootstrap.py run   [arguments of `fishbed run`]
    python3 tools/bootstrap.py test  [arguments of pytest]
    python3 tools/bootstrap.py env   only makes the environment (with the test packages)
"""

# Old Pythons must parse this file, or they could not complain: no syntax newer than 3.6 in it.
# ruff: noqa: UP031
import hashlib
import os
import shutil
import subprocess
import sys

ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
OLDEST = (3, 11)
USAGE = "usage: python3 tools/bootstrap.py run|test|env [arguments passed on]"


class SetUpError(Exception):
    """Set-up cannot go on; the text is one line with the remedy."""


def say(text: str) -> None:
    """One line of progress, on stderr: stdout belongs to the command that follows."""
    print("bootstrap: " + text, file=sys.stderr, flush=True)


def environment_dir() -> str:
    """Where the environment lives; FISHBED_VENV moves it."""
    return os.environ.get("FISHBED_VENV") or os.path.join(ROOT, ".venv")


def program(venv: str, name: str) -> str:
    """Path of an executable inside the environment."""
    folder, suffix = ("Scripts", ".exe") if os.name == "nt" else ("bin", "")
    return os.path.join(venv, folder, name + suffix)


def fingerprint(extra: str) -> str:
    """Hash of all that the environment is made from."""
    digest = hashlib.sha256()
    for text in (extra, sys.version, ROOT):
        digest.update(text.encode() + b"\0")
    for name in ("pyproject.toml", "constraints.txt"):
        with open(os.path.join(ROOT, name), "rb") as file:
            digest.update(file.read() + b"\0")
    return digest.hexdigest()


def up_to_date(venv: str, extras: "list[str]") -> bool:
    """Whether the environment was made from exactly what is here now, for one of the extras."""
    try:
        with open(os.path.join(venv, "fishbed.stamp"), encoding="ascii") as file:
            stamp = file.read().strip()
    except OSError:
        return False
    return os.path.exists(program(venv, "python")) and stamp in [fingerprint(e) for e in extras]


def step(what: str, command: "list[str]") -> None:
    """Run one step of the set-up; its failure is one line that names the step."""
    say(what)
    done = subprocess.run(command, cwd=ROOT, stdout=sys.stderr, check=False)
    if done.returncode:
        raise SetUpError(
            "'%s' failed (exit %d): see the lines above; packages come from the network, "
            "or from the index that pip is configured for" % (what, done.returncode)
        )


def make_environment(extra: str) -> str:
    """Make the environment, unless there is one that fits; returns its directory."""
    venv = environment_dir()
    # An environment with the test packages also serves a plain run.
    if up_to_date(venv, [extra, "test"]):
        say("environment %s is up to date" % venv)
        return venv
    pip = [program(venv, "python"), "-m", "pip", "install", "--quiet", "-c", "constraints.txt"]
    pip.append("--disable-pip-version-check")
    adding = up_to_date(venv, [""])
    if adding:
        say("adding the packages of '%s' to %s" % (extra, venv))
        os.remove(os.path.join(venv, "fishbed.stamp"))
    else:
        create(venv)
        # The builder is pinned as well: it is installed first, no isolated build fetches another.
        step("installing the pinned builder", [*pip, "setuptools"])
    try:
        step(
            "installing fishbed and its pinned packages (some minutes at first)",
            [*pip, "--no-build-isolation", "--editable", ".[%s]" % extra if extra else "."],
        )
    except SetUpError:
        if adding:  # pip takes back what it cannot finish: what was there still serves runs
            write_stamp(venv, "")
        raise
    write_stamp(venv, extra)
    return venv


def write_stamp(venv: str, extra: str) -> None:
    """Note what an environment was made from."""
    with open(os.path.join(venv, "fishbed.stamp"), "w", encoding="ascii") as file:
        file.write(fingerprint(extra) + "\n")


def create(venv: str) -> None:
    """Make an empty environment in the place of what was there."""
    try:
        import ensurepip  # noqa: F401
        import venv as venv_module
    except ImportError as error:
        raise SetUpError(
            "this Python has no '%s' module: on Debian or Ubuntu, apt install python3-venv"
            % error.name
        ) from error
    if os.path.exists(venv) and not os.path.exists(os.path.join(venv, "pyvenv.cfg")):
        raise SetUpError("%s exists and is no environment: move it, or set FISHBED_VENV" % venv)
    say("making %s with Python %s" % (venv, sys.version.split()[0]))
    try:
        shutil.rmtree(venv, ignore_errors=True)
        venv_module.create(venv, with_pip=True)
    except (OSError, subprocess.CalledProcessError) as error:
        raise SetUpError("cannot make %s: %s" % (venv, error)) from error


def run(venv: str, arguments: "list[str]") -> int:
    """The default scenario, or the one that is named."""
    command = [program(venv, "fishbed"), "run", *arguments]
    if os.name == "posix":
        # Take this process's place: Ctrl-C must reach the run, which ends its folder properly.
        os.execv(command[0], command)
    return subprocess.run(command, check=False).returncode


def test(venv: str, arguments: "list[str]") -> int:
    """Every check of the project; all are run, the first failure's exit code is returned."""
    checks = (
        ("lint", [program(venv, "ruff"), "check", "."]),
        ("types", [program(venv, "mypy")]),
        ("import contract", [program(venv, "lint-imports")]),
        ("tests", [program(venv, "python"), "-m", "pytest", "-n", "2", *arguments]),
    )
    first, failed = 0, []
    for name, command in checks:
        say("check: " + name)
        code = subprocess.run(command, cwd=ROOT, check=False).returncode
        if code:
            failed.append(name)
            first = first or code
    say("failed: " + ", ".join(failed) if failed else "all checks passed")
    return first


def main(arguments: "list[str]") -> int:
    """Do what the first argument says; returns the exit code to pass on."""
    if len(arguments) < 1 or arguments[0] not in ("run", "test", "env"):
        print(USAGE, file=sys.stderr)
        return 2
    what, rest = arguments[0], arguments[1:]
    if sys.version_info < OLDEST:
        print(
            "bootstrap: Python %d.%d or newer is needed, this is %s: "
            "name a newer one, such as python3.12 tools/bootstrap.py %s"
            % (OLDEST[0], OLDEST[1], sys.version.split()[0], what),
            file=sys.stderr,
        )
        return 2
    try:
        venv = make_environment("" if what == "run" else "test")
    except (SetUpError, OSError) as error:
        print("bootstrap: %s" % error, file=sys.stderr)
        return 2
    if what == "env":
        return 0
    return run(venv, rest) if what == "run" else test(venv, rest)


if __name__ == "__main__":
    try:
        sys.exit(main(sys.argv[1:]))
    except KeyboardInterrupt:
        sys.exit(130)
