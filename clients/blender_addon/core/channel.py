# SPDX-License-Identifier: GPL-3.0-or-later
"""A connection to skind for programs with a loop of their own: `Channel`, pumped from a timer.

    closed ──open──► connecting ──up──► greeting ──hello──► ready
                       ▲   └─nobody─► starting ─┐             │
                       └──── waiting ◄──────────┴────lost─────┘

Owns the socket and the requests that wait; knows no bpy. No thread and no waiting: everything
happens in pump(), callbacks too. One thread at a time. Link is the blocking one, for scripts.
"""

from __future__ import annotations

import getpass
import os
import secrets
import time
from typing import Callable

from .calls import Calls
from .dial import Nobody, Refused, Retry, dial, shown
from .exchange import Exchange
from .launch import Launcher
from .stream import Stream
from .wire import PROTOCOL, Message, SkindError, WireError

USER_BYTES_MAX = 64
LAUNCH_PAUSE_S = 2.0
HELLO_S = 5.0  # a greeting is answered at once, whatever is being solved
SILENCE_S = 10.0
NOT_RUNNING = "skind does not run: start it with 'skinctl start'"  # nobody listens, no launcher

Done = Callable[["dict | None", "SkindError | None"], None]
Request = Callable[[str, dict, Done], "int | None"]  # sends one; what Sculpt.request is


class Channel:
    """A connection to skind that mends itself. `path` is a socket's, or "tcp:PORT"; `user`
    the person, "" by the name of the login.

    state       "closed", "connecting", "starting" (the daemon is being started), "greeting",
                "ready", or "waiting" (for the next try)
    hello       hello's last result, {} before the first; kept while the connection is lost
    generation  how often it became ready

    Callbacks, all from pump() and in the order in which things happened: on_ready();
    on_notification(message); on_lost(reason) when what was ready broke, after the `done` of its
    requests; on_error(exception) for what a callback raised: without it pump() raises that, at its
    end. A callback may call request, cancel, open and close.
    """

    def __init__(self, path: str, *, name: str, version: str = "", user: str = "",
                 launcher: Launcher | None = None,
                 clock: Callable[[], float] = time.monotonic) -> None:
        self.path = os.fspath(path)
        self.launcher = launcher
        self.state = "closed"
        self.hello: dict = {}
        self.generation = 0
        self.on_ready: Callable[[], None] | None = None
        self.on_lost: Callable[[str], None] | None = None
        self.on_notification: Callable[[Message], None] | None = None
        self.on_error: Callable[[Exception], None] | None = None
        self._client = {"name": name, "version": version, "id": secrets.token_hex(8),
                        "user": _fitting(user or _login())}
        self._clock = clock
        self._stream: Stream | None = None  # while greeting or ready
        self._pending: dict[int, Done | None] = {}  # without the hello
        self._calls = Calls()
        self._pumping = False
        self._problem = ""
        self._farewell = ""  # the reason in the daemon's bye
        self._next_id = 1  # over all connections, so that an old id means nothing to a new one
        self._heard_at = 0.0
        self._retry = Retry(clock)

    @property
    def capabilities(self) -> frozenset[str]:
        """What the daemon can do, by hello's names."""
        return frozenset(self.hello.get("capabilities", ()))

    @property
    def unanswered(self) -> int:
        """How many requests wait for their answer."""
        return len(self._pending)

    @property
    def unsent_bytes(self) -> int:
        return self._stream.unsent_bytes if self._stream is not None else 0

    @property
    def silence_s(self) -> float:
        """Seconds since the daemon was last heard, while it owes an answer; else 0."""
        if self._stream is None or not self._stream.exchange.unanswered:
            return 0.0
        return max(0.0, self._clock() - self._heard_at)

    @property
    def problem(self) -> str:
        """One sentence for the user: what is wrong, and what to do; "" when nothing is."""
        silence = self.silence_s
        if self.state == "greeting" and silence >= HELLO_S:
            return (f"connected, but skind does not answer ({silence:.0f} s): wait a little, or "
                    "end skind and start it again")
        if self.state == "ready" and silence >= SILENCE_S:
            return (f"skind has not answered for {silence:.0f} s: with a large stroke or file this "
                    "is normal; wait, or cancel what it does")
        return self._problem

    # ---- what the program calls ----

    def open(self) -> None:
        """Begins to connect, and stays at it until close(); while waiting: tries at once."""
        if self.state not in ("closed", "waiting"):
            return
        self.state = "connecting"
        self._problem = "connecting to skind"
        self._retry.reset()

    def close(self) -> None:
        """Ends the connection, or the tries for one. Nothing is called back any more."""
        if self.launcher is not None:
            self.launcher.close()
        self._calls.clear()
        self._give_up("")

    def request(self, method: str, params: dict | None = None, done: Done | None = None) -> int:
        """Queues a request and returns its id; done(result, None) or done(None, error) follows.

        NumPy arrays may stand in params; leave them as they are until the answer. An error named
        "lost" says that the connection broke: it was carried out or not. Raises ConnectionError
        while not ready, TypeError and ValueError for what does not travel.
        """
        if self.state != "ready":
            raise ConnectionError(self.problem or "there is no connection to skind; open one")
        id = self._ask(method, params)
        self._pending[id] = done
        return id

    def cancel(self, id: int) -> None:
        """Asks for a request to be given up; it is answered all the same. Others: does nothing."""
        if id in self._pending:
            self._stream.push(self._stream.exchange.cancel(id))

    def pump(self, budget_s: float = 0.004) -> None:
        """Connects, writes, reads and calls back, whatever can be done now; ends with the budget.

        The clock is looked at after each portion and each callback, so either may overrun the
        budget by itself. Called from a callback, it does nothing.
        """
        if self._pumping:
            return
        self._pumping = True
        end = self._clock() + budget_s
        try:
            while (self._calls.make_one(self.on_error) or self._step()) and self._clock() < end:
                pass
        finally:
            self._pumping = False
        self._calls.raise_failure()

    # ---- what pump does ----

    def _step(self) -> bool:
        """One step from the state that it is in; False: nothing can be done now."""
        if self._stream is not None:
            return self._exchange()
        if self.state == "starting":
            return self._look_after_start()
        if self.state == "connecting" or (self.state == "waiting" and self._retry.is_due):
            self._connect()
            return True
        return False

    def _connect(self) -> None:
        just_started, self.state = self.state == "starting", "connecting"
        try:
            token = shown(self.path)
            connection = dial(self.path)
        except Nobody:
            self._launch(just_started)
        except Refused as error:
            (self._give_up if error.final else self._wait)(str(error))
        else:
            self._stream = Stream(connection, Exchange(first_id=self._next_id))
            self._farewell = ""
            self.state = "greeting"
            self._problem = "skind is being greeted"
            self._ask("hello", {"protocol": PROTOCOL, "client": self._client, **token})

    def _launch(self, just_started: bool) -> None:
        """Nobody listens."""
        if self.launcher is None:
            self._wait(NOT_RUNNING)
        elif just_started:
            self._wait("skind ended right after its start: skind.log beside its socket "
                       f"({self.path}) says why", LAUNCH_PAUSE_S)
        else:
            self.launcher.start()
            self.state = "starting"
            # What went wrong the last time stays to be read while it is tried again.
            self._problem = self.launcher.problem or "skind is being started"

    def _look_after_start(self) -> bool:
        outcome = self.launcher.poll()
        if outcome == "done":
            self._connect()
        elif outcome == "failed":
            self._wait(self.launcher.problem, LAUNCH_PAUSE_S)
        return outcome != "running"

    def _ask(self, method: str, params: dict | None) -> int:
        exchange = self._stream.exchange
        if not exchange.unanswered:
            self._heard_at = self._clock()  # from now on an answer is owed
        id, pieces = exchange.request(method, params)
        self._stream.push(pieces)
        self._next_id = id + 1
        return id

    def _exchange(self) -> bool:
        """A portion out and a portion in."""
        sent = received = 0
        reason = ""
        try:
            sent = self._stream.send()
            received = self._stream.receive()
        except ConnectionError:
            reason = self._farewell or "skind ended"
        except WireError as error:
            reason = f"what came is not understood: {error}"
        except (SkindError, OSError, MemoryError) as error:
            reason = str(error)
        if received:
            self._heard_at = self._clock()
            self._take_messages()
        if reason:
            self._lose(reason)
        return bool(sent or received or reason)

    def _take_messages(self) -> None:
        """Queues the calls for what came; each portion ends at most one message."""
        exchange = self._stream.exchange
        while exchange.notifications:
            message = exchange.notifications.popleft()
            if message.method == "bye":
                self._farewell = str(message.params.get("reason", ""))
            else:
                self._calls.add(self.on_notification, message)
        for message in exchange.take_all():
            if self.state == "greeting":
                self._greet(message)
            else:
                self._calls.add(self._pending.pop(message.id), message.result, message.error)

    def _greet(self, message: Message) -> None:
        """Hello's answer."""
        if message.error is not None and message.error.name == "version":
            self._give_up(f"{message.error.message} (the client is {self._client['name']})")
        elif message.error is not None:
            self._lose(str(message.error))
        elif not _is_hello(message.result):
            self._lose("its greeting is not skind's")
        else:
            self.hello = message.result
            self.generation += 1
            self.state = "ready"
            self._problem = ""
            self._calls.add(self.on_ready)

    def _lose(self, reason: str) -> None:
        """The connection is of no use any more."""
        if self.state == "greeting":
            self._drop()
            self._wait(f"the greeting failed ({reason}): it is tried again; if that is not skind "
                       f"at {self.path}, choose another path with SKIND_SOCKET")
            return
        for done in self._pending.values():
            self._calls.add(done, None, SkindError(
                0, "lost", f"the connection to skind was lost: {reason}", retryable=True))
        self._calls.add(self.on_lost, reason)
        self._retry.lost()
        self._drop()
        self._wait(f"the connection to skind was lost ({reason}): it is tried again")

    def _drop(self) -> None:
        if self._stream is not None:
            self._stream.close()
        self._stream = None
        self._pending = {}

    def _wait(self, problem: str, least_s: float = 0.0) -> None:
        self.state = "waiting"
        self._problem = problem
        self._retry.pause(least_s)

    def _give_up(self, problem: str) -> None:
        """No further tries before the next open()."""
        self._drop()
        self.state = "closed"
        self._problem = problem


def _login() -> str:
    try:
        return getpass.getuser()
    except (OSError, KeyError):  # the system knows no name for whose process this is
        return ""


def _fitting(user: str) -> str:
    return user.encode()[:USER_BYTES_MAX].decode(errors="ignore")


def _is_hello(result: dict) -> bool:
    names = result.get("capabilities")
    return (isinstance(names, list) and all(isinstance(name, str) for name in names)
            and result.get("protocol") in range(PROTOCOL["min"], PROTOCOL["max"] + 1))
