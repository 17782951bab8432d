"""A Python that has imported what takes seconds, and runs modules in forks of itself.

Each module runs as ``python -m`` runs it, in a process of its own that imports the project anew. Only
libraries are imported before, none of which looks at the environment or opens anything.
"""

import json
import os
import runpy
import subprocess
import sys
import tempfile
from pathlib import Path

LIBRARIES = (
    "torch._dynamo",
    "torchrl.collectors",
    "torchrl.data",
    "torchrl.envs",
    "torchrl.modules",
    "torchrl.objectives",
    "hydra",
    "scipy.stats",
)


class WarmPython:
    """Runs modules, one at a time. Where processes cannot be forked safely, each starts afresh."""

    def __init__(self):
        self._server = None

    def run(self, module, arguments, cwd, environment):
        """Runs a module to its end, which is returned as :func:`subprocess.run` does."""
        line = [sys.executable, "-m", module, *map(str, arguments)]
        if sys.platform != "linux":
            given = {"cwd": cwd, "env": environment, "capture_output": True, "text": True}
            return subprocess.run(line, timeout=300, **given)
        if self._server is None:
            pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
            self._server = subprocess.Popen([sys.executable, "-W", "ignore", __file__], **pipes)
        with tempfile.TemporaryDirectory() as folder:
            streams = [str(Path(folder, name)) for name in ("out", "err")]
            asked = [module, line[3:], str(cwd), dict(environment), streams]
            self._server.stdin.write(json.dumps(asked) + "\n")
            self._server.stdin.flush()
            status = int(self._server.stdout.readline())
            said = [Path(stream).read_text("utf-8", "surrogateescape") for stream in streams]
        return subprocess.CompletedProcess(line, status, *said)

    def close(self):
        """Ends the Python that waits."""
        if self._server is not None:
            self._server.stdin.close()
            self._server.stdout.close()
            self._server.wait()


def serve():
    """Forks for each line on standard input, and answers with the exit status of the fork."""
    for name in LIBRARIES:
        __import__(name)
    for line in sys.stdin:
        child = os.fork()
        if child == 0:
            return json.loads(line)
        status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        print(status, flush=True)
    return None


def become(module, arguments, cwd, environment, streams):
    """Makes this process one that ``python -m`` would have started, and runs the module."""
    for number, path in enumerate(("/dev/null", *streams)):
        opened = os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND, 0o600)
        os.dup2(opened, number)
        os.close(opened)
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        stream = os.fdopen(number, "w" if number else "r", 1, "utf-8", closefd=False)
        setattr(sys, name, stream)
        setattr(sys, f"__{name}__", stream)
    os.environ.clear()
    os.environ.update(environment)
    os.chdir(cwd)
    sys.path[0:1] = [str(cwd), *filter(None, environment.get("PYTHONPATH", "").split(os.pathsep))]
    sys.argv[1:] = arguments
    sys.warnoptions.clear()
    import warnings

    warnings.resetwarnings()
    for category in (DeprecationWarning, PendingDeprecationWarning, ImportWarning, ResourceWarning):
        warnings.simplefilter("ignore", category)
    runpy.run_module(module, run_name="__main__", alter_sys=True)


if __name__ == "__main__":
    asked = serve()
    if asked is not None:
        become(*asked)
