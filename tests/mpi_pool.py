"""Processes of MPI that run the programs of many tests, because each start takes two seconds."""

from __future__ import annotations

import faulthandler
import json
import linecache
import os
import select
import socket
import subprocess
import sys
import tempfile
import traceback

from project import ROOT

MOST = 3
"""Processes; a program gets the first of them."""
LONGEST = 1200.0
"""Time for the start and for each program [s]: processes that wait for each other share few cores
with other tests."""


class Crew:
    """A group of processes that starts with its first program, and anew after one that failed."""

    def __init__(self) -> None:
        self._lines: list[socket.socket] = []

    def run(self, ranks: int, program: str, *arguments: object) -> None:
        """Run a program on a few ranks, where it finds their `comm` and its `arguments`."""
        if not self._lines:
            self._start()
        order = json.dumps([ranks, program, [str(value) for value in arguments]]) + "\n"
        waiting = {line: line.makefile() for line in self._lines[:ranks]}
        for line in waiting:
            line.sendall(order.encode())
        answer = '""'
        while waiting and answer == '""':
            ready, _, _ = select.select(list(waiting), [], [])
            answer = waiting.pop(ready[0]).readline().strip()
        if answer != '""':
            said = self.close()  # others may wait for the one that failed
            raise AssertionError(json.loads(answer or '"a process has ended"') + "\n" + said)

    def close(self) -> str:
        """End all processes; return what they have written to stderr."""
        if not self._lines:
            return ""
        self._process.terminate()
        self._process.wait()
        for line in self._lines:
            line.close()
        self._lines = []
        with self._errors:
            self._errors.seek(0)
            return self._errors.read()

    def _start(self) -> None:
        self._errors = tempfile.TemporaryFile("w+")
        with tempfile.TemporaryDirectory() as folder, socket.socket(socket.AF_UNIX) as door:
            door.bind(f"{folder}/door")
            door.listen()
            door.settimeout(LONGEST)
            mpirun = ["mpirun", "--allow-run-as-root", "--oversubscribe", "-n", str(MOST)]
            self._process = subprocess.Popen(
                [*mpirun, sys.executable, __file__, f"{folder}/door"],
                env=os.environ | {"PYTHONPATH": f"{ROOT}:{ROOT / 'tests'}"},
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=self._errors,
            )
            came = [door.accept()[0] for _ in range(MOST)]
        self._lines = sorted(came, key=lambda line: line.recv(1))


def serve(door: str) -> None:
    """Run programs as they come, until the line is closed; wait without keeping a core busy."""
    from delam_fem.api import MPI
    from delam_fem.system.mpi import start_petsc

    start_petsc()  # all together
    world = MPI.COMM_WORLD
    groups = [world.Split(int(world.rank >= ranks)) for ranks in range(MOST + 1)]
    with socket.socket(socket.AF_UNIX) as line:
        line.connect(door)
        line.sendall(str(world.rank).encode())
        for order in line.makefile():
            ranks, program, arguments = json.loads(order)
            linecache.cache["program"] = len(program), None, program.splitlines(True), "program"
            answer = ""
            faulthandler.dump_traceback_later(LONGEST, exit=True)  # where it waits for others
            try:
                names = {"__name__": "program", "comm": groups[ranks], "arguments": arguments}
                exec(compile(program, "program", "exec"), names)
            except BaseException:
                answer = traceback.format_exc()
            faulthandler.cancel_dump_traceback_later()
            line.sendall(json.dumps(answer).encode() + b"\n")


if __name__ == "__main__":
    serve(sys.argv[1])
