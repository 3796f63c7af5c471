"""64 clients at work and 1,000 idle ones, while others connect and hang up at every point.

The points are all message boundaries of a whole conversation and places within its messages (all
bytes in the full run). After it every request was answered, every revision told, and everybody who
was there is still there.
"""

from __future__ import annotations

import random
import socket
import time
from dataclasses import dataclass, field

import numpy as np
from core import Link
from core.wire import encode_request

from .. import work
from ..yard import Daemon, Yard, expect

ACTIVE, IDLE, SESSIONS = 64, 1000, 8
DEPTH = 2  # requests that a client has under way
VERTICES = 300


@dataclass
class Client:
    link: Link
    recipe: work.Recipe
    asked: list[int] = field(default_factory=list)
    answered: int = 0
    revisions: list[int] = field(default_factory=list)

    def step(self) -> None:
        self.link.pump()
        for id in list(self.asked):
            result = self.link.exchange.take(id)
            if result is not None:
                self.asked.remove(id)
                self.answered += 1
                self.revisions.append(result["revision"])
        while len(self.asked) < DEPTH:
            self.asked.append(self.link.send(*self.recipe.stroke()))

    def settle(self) -> None:
        for id in self.asked:
            self.revisions.append(self.link.wait(id)["revision"])
            self.answered += 1
        self.asked.clear()


def conversation() -> list[bytes]:
    """Each message of a whole visit, as bytes."""
    recipe = work.Recipe("s0", VERTICES, 99)
    some = np.arange(5, dtype=np.uint32)
    visit = [("hello", {"protocol": {"min": 1, "max": 1}, "client": {"name": "guest"}}),
             ("session.list", {}), ("session.attach", {"session": "s0"}),
             ("pose.evaluate", {"session": "s0", "pose": "a", "vertices": some}),
             recipe.stroke(), ("history.undo", {"session": "s0"}),
             ("weights.get", {"session": "s0", "vertices": some}),
             ("session.create", {"name": "guest", **work.rigs.sheet(16)}),
             ("session.close", {"session": "guest"}), ("session.detach", {"session": "s0"})]
    return [b"".join(bytes(piece) for piece in encode_request(id, method, params))
            for id, (method, params) in enumerate(visit, 1)]


def cuts(messages: list[bytes], pieces: int) -> list[int]:
    """How many bytes of the visit are sent before the guest hangs up."""
    points, at = set(), 0
    for message in messages:
        points.update({at, at + 1, at + 15, at + 16, at + len(message) - 1, at + len(message)})
        step = max(1, len(message) // pieces)
        points.update(range(at, at + len(message), step))
        at += len(message)
    return sorted(point for point in points if point <= at)


def visit_and_drop(daemon: Daemon, raw: bytes, pick: random.Random) -> None:
    """Sends this much, and is gone: at once, after some of the answers, or after saying so."""
    guest = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    guest.settimeout(5)
    try:
        guest.connect(str(daemon.socket))
        how = pick.choice(["now", "half", "read"])
        guest.sendall(raw)
        if how == "half":
            guest.shutdown(socket.SHUT_WR)
        if how == "read" and raw:
            guest.settimeout(0.002)
            guest.recv(100)
    except OSError:
        pass  # the daemon hung up first; what matters is how everybody else fares
    finally:
        guest.close()


def check(daemon: Daemon, clients: list[Client], idle: list[Link]) -> None:
    for client in clients:
        client.settle()
        # Guests do strokes and undo too, so that revisions only have to rise.
        expect(client.revisions == sorted(set(client.revisions)), "a revision was told twice")
    for link in idle:
        link.call("ping")
    with daemon.link() as link:
        for index in range(SESSIONS):
            work.check_simplex(link, f"s{index}")
        deadline = time.monotonic() + 10
        while link.call("stats")["connections"] != ACTIVE + IDLE + 1:
            expect(time.monotonic() < deadline, "connections of those who left are still counted")
            time.sleep(0.02)


def measure(yard: Yard, seconds: float) -> dict:
    pick = random.Random(5)
    messages = conversation()
    with yard.daemon() as daemon:
        with daemon.link() as link:
            for index in range(SESSIONS):
                work.create(link, f"s{index}", VERTICES)
        before = daemon.descriptors()
        idle = [daemon.link() for _ in range(IDLE)]
        clients = [Client(daemon.link(), work.Recipe(f"s{index % SESSIONS}", VERTICES, index))
                   for index in range(ACTIVE)]
        whole, points = b"".join(messages), cuts(messages, yard.pick(4000, 8))
        began, dropped = time.monotonic(), 0
        for point in points:
            visit_and_drop(daemon, whole[:point], pick)
            dropped += 1
            clients[dropped % ACTIVE].step()
            if dropped % 8 == 0:
                for client in clients:
                    client.step()
            if time.monotonic() - began > 3 * seconds:
                expect(False, f"only {dropped} of {len(points)} points in {3 * seconds:.0f} s")
        check(daemon, clients, idle)
        active = sum(client.answered > 0 for client in clients)
        answers = sum(client.answered for client in clients)
        for link in [*idle, *(client.link for client in clients)]:
            link.close()
        deadline = time.monotonic() + 10
        while daemon.descriptors() > before and time.monotonic() < deadline:
            time.sleep(0.01)
        expect(daemon.descriptors() <= before, "descriptors are left open")
    yard.say(f"  {dropped} drops, {answers} strokes answered meanwhile")
    return {"clients_active": active, "clients_idle": len(idle)}
