"""The policy host's end of a lane: the package's only user of iceoryx2.

Two services carry pages (`observation` to the host, `action` back), an event each wakes either side. The simulator
creates them; the host opens them, after comparing what both must agree on.
"""

import ctypes
import os
import shutil
import time
from pathlib import Path

import iceoryx2 as iox
import numpy as np

from .invitation import CLAIM
from .layout import ACTION_BLOCK, PAGE_BYTES, SCHEMA_HASH, ActionHeader, ObservationHeader, Page
from .segment import Segment, SegmentGone

SHM = Path("/dev/shm")
IPC = iox.ServiceType.Ipc
# The event that wakes the simulator, shared by its lanes, and the only number that is rung.
SIM_WAKE = "hyp/sim/wake"
RING = 0
# How long a simulator may take to create the lane, and another host to leave it, in seconds.
OPEN_PATIENCE_S = 60.0
OCCUPIED_PATIENCE_S = 5.0
# How long the simulator may hold all the memory for answers.
LOAN_PATIENCE_S = 1.0
PAUSE_S = 0.005

ABSENT = ("DoesNotExist", "HangsInCreation", "IsMarkedForDestruction", "Interrupt")
OCCUPIED = (
    "ExceedsMaxNumberOfNodes",
    "ExceedsMaxSupportedListeners",
    "ExceedsMaxSupportedNotifiers",
    "ExceedsMaxSupportedPublishers",
    "ExceedsMaxSupportedSubscribers",
)


class LinkError(Exception):
    """An operation of the link that failed."""


class RunEnded(Exception):
    """The run is over."""


class _Later(Exception):
    """Another attempt may succeed."""

    def __init__(self, message, patience_s):
        super().__init__(message)
        self.patience_s = patience_s


class Message:
    """A received observation message; the simulator cannot use its memory again until it is released."""

    def __init__(self, sample, header, pages):
        self.header = header
        """`ObservationHeader`, a copy."""
        self.pages = pages
        """`[n_bytes] u8`, in shared memory, read-only."""
        self._sample = sample

    def release(self):
        self.pages = None
        self._sample.delete()


class Lane:
    """Attached from construction to `close`."""

    def __init__(self, invitation):
        """Attaches to the lane; waits for the simulator to create it, or for the lane's last host to leave."""
        self.invitation = invitation
        self._segment = None
        if invitation.schema_hash != SCHEMA_HASH:
            raise LinkError(schema_message(invitation.schema_hash))
        # What iceoryx2 logs is raised as well, or is expected when a run ends under our feet.
        iox.set_log_level_from_env_or(iox.LogLevel.Fatal)
        try:
            self._node = join(invitation)
            self._open_patiently()
        except BaseException:
            self.close()
            raise

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()

    def close(self):
        """Leaves the lane, and nothing behind."""
        self._drop_ports()
        self._segment = self._node = None
        self._sweep()

    def receive(self):
        """The oldest `Message` not received yet, or None. Returns at once."""
        sample = self._observations.receive()
        if sample is None:
            return None
        n_pages = sample.header.number_of_elements
        most = self.invitation.max_envs * self.invitation.block_pages
        if n_pages > most:
            sample.delete()
            raise LinkError(f"an observation message claims {n_pages} pages, one of this lane has at most {most}")
        header = ObservationHeader.from_buffer_copy(ctypes.string_at(sample.user_header_ptr, 64))
        try:
            pages = self._pages(sample, n_pages * PAGE_BYTES)
        except SegmentGone:
            # Nobody waits for an answer.
            sample.delete()
            return None
        return Message(sample, header, pages)

    def has_message(self):
        """Whether `receive` would return a message."""
        return self._observations.has_samples()

    def wait(self, timeout_s):
        """Waits until the simulator has rung or the time is over; a signal ends it, too."""
        try:
            self._ear.timed_wait(iox.Duration.from_secs_f64(timeout_s))
        except iox.ListenerWaitError as error:
            if "InterruptSignal" not in str(error):
                raise LinkError(f"failed to wait for the simulator: {error}") from error

    def reply(self, message, status, fill):
        """Answers a message, which is released: `fill` writes its `[n_envs] ACTION_BLOCK`, zero before."""
        n_envs = min(max(message.header.n_envs, 1), self.invitation.max_envs)
        loan = self._loan(n_envs)
        n_bytes = n_envs * PAGE_BYTES
        ctypes.memset(loan.payload_ptr, 0, n_bytes)
        fill(np.frombuffer((ctypes.c_uint8 * n_bytes).from_address(loan.payload_ptr), ACTION_BLOCK))
        asked = message.header
        header = ActionHeader(SCHEMA_HASH, asked.run, asked.sequence, asked.epoch, n_envs, status)
        ctypes.memmove(loan.user_header_ptr, ctypes.addressof(header), ctypes.sizeof(header))
        message.release()
        try:
            # A simulator that has died is no failure: its successor asks anew.
            loan.assume_init().send()
        except iox.SendError as error:
            raise LinkError(f"failed to send an answer: {error}") from error
        self._ring()

    def _open_patiently(self):
        start = time.monotonic()
        while True:
            try:
                return self._open()
            except _Later as reason:
                self._drop_ports()
                if not self.invitation.run_is_alive():
                    raise RunEnded from None
                if time.monotonic() - start >= reason.patience_s:
                    raise LinkError(str(reason)) from None
                self._node.try_cleanup_dead_nodes()
                time.sleep(PAUSE_S)

    def _open(self):
        lane = f"hyp/lane/{self.invitation.lane}"
        observation, action, wake = f"{lane}/observation", f"{lane}/action", f"{lane}/wake"
        for service in (observation, action):
            self._check_agreement(service)
        observations = self._open_messages(observation, ObservationHeader)
        actions = self._open_messages(action, ActionHeader)
        wakes = self._open_event(wake)
        sim_wakes = self._open_event(SIM_WAKE)
        self._ear = attempt(wake, wakes.listener_builder().create)
        self._bell = attempt(SIM_WAKE, sim_wakes.notifier_builder().default_event_id(iox.EventId.new(RING)).create)
        publisher = (
            actions.publisher_builder()
            .initial_max_slice_len(self.invitation.max_envs)
            .allocation_strategy(iox.AllocationStrategy.Static)
            .max_loaned_samples(1)
            # The simulator has room for as many answers as it has questions: only a dead one's queue is ever full.
            .backpressure_strategy(iox.BackpressureStrategy.DiscardData)
        )
        self._actions = attempt(action, publisher.create)
        self._reserve(self._actions.id.value)
        # Last: from here on the simulator sees a host, and everything it needs is there.
        self._observations = attempt(observation, observations.subscriber_builder().create)

    def _drop_ports(self):
        for name in ("_observations", "_actions", "_ear", "_bell"):
            port = self.__dict__.pop(name, None)
            if port is not None:
                port.delete()

    def _check_agreement(self, service):
        """Compares the attributes of a service with the invitation: they say more than a mismatch of types would."""
        name = iox.ServiceName.new(service)
        try:
            details = iox.Service.details(name, self._node.config, iox.MessagingPattern.PublishSubscribe, IPC)
        except iox.ServiceDetailsError as error:
            raise _Later(f"failed to look at service {service}: {error}", OPEN_PATIENCE_S) from error
        if details is None:
            raise _Later(f"no simulator has created service {service}", OPEN_PATIENCE_S)
        values = {attribute.key.to_string(): attribute.value.to_string() for attribute in details.attributes().values}
        invitation = self.invitation
        expected = {
            "schema": f"{SCHEMA_HASH:016x}",
            "lane": str(invitation.lane),
            "policy": invitation.policy,
            "max_envs": str(invitation.max_envs),
            "block_pages": str(invitation.block_pages),
            "in_flight": str(invitation.in_flight),
        }
        for field, value in expected.items():
            found = values.get(field, "absent")
            if found == value:
                continue
            if field == "schema" and found != "absent":
                raise LinkError(schema_message(int(found, 16)))
            raise LinkError(f"cannot attach to service {service}: its {field} is {found}, expected {value}")

    def _open_messages(self, service, header):
        builder = self._node.service_builder(iox.ServiceName.new(service))
        return attempt(service, builder.publish_subscribe(iox.Slice[Page]).user_header(header).open)

    def _open_event(self, service):
        return attempt(service, self._node.service_builder(iox.ServiceName.new(service)).event().open)

    def _reserve(self, publisher_id):
        """Takes all the memory of our answers now, so that a full /dev/shm is an error and no signal later."""
        suffix = f"_{publisher_id}.data"
        for path in SHM.glob(f"{self.invitation.prefix}*{suffix}"):
            file = os.open(path, os.O_RDWR | os.O_CLOEXEC)
            try:
                os.posix_fallocate(file, 0, os.fstat(file).st_size)
            except OSError as error:
                raise LinkError(f"no room in {SHM} for the answers ({error}); enlarge it") from error
            finally:
                os.close(file)

    def _pages(self, sample, n_bytes):
        # A new simulator's memory may well lie at the addresses of its predecessor's.
        sender = sample.header.publisher_id.value
        if self._segment is None or self._segment.sender != sender:
            self._segment = Segment(sample.payload_ptr, sender)
        return self._segment.bytes_at(sample.payload_ptr, n_bytes)

    def _loan(self, n_pages):
        start = time.monotonic()
        while True:
            try:
                return self._actions.loan_slice_uninit(n_pages)
            except iox.LoanError as error:
                if "OutOfMemory" not in str(error) or time.monotonic() - start > LOAN_PATIENCE_S:
                    raise LinkError(f"failed to get memory for {n_pages} answers: {error}") from error
                # Takes back what a dead simulator held.
                self._actions.update_connections()
                time.sleep(PAUSE_S)

    def _ring(self):
        try:
            self._bell.notify()
        except iox.NotifierNotifyError:
            # A ring that nobody hears is no failure: every wait ends by itself.
            pass

    def _sweep(self):
        """Removes what our leaving, or joining too late, has left of a run that is over: its lock is gone."""
        root = self.invitation.root
        if (root / CLAIM).exists() or root != self.invitation.path.parent.parent:
            return
        for path in SHM.glob(f"{self.invitation.prefix}*"):
            path.unlink(missing_ok=True)
        shutil.rmtree(root, ignore_errors=True)


def join(invitation):
    """This process's node in the domain of a run. No file of iceoryx2's own configuration is read."""
    config = iox.config.default()
    config.global_cfg.prefix = iox.FileName.new(invitation.prefix)
    config.global_cfg.root_path = iox.Path.new(str(invitation.root))
    builder = iox.NodeBuilder.new().name(iox.NodeName.new("python policy host")).config(config)
    try:
        return builder.signal_handling_mode(iox.SignalHandlingMode.Disabled).create(IPC)
    except iox.NodeCreationFailure as error:
        if not invitation.run_is_alive():
            raise RunEnded from error
        raise LinkError(f"failed to join the run in {invitation.root}: {error}") from error


def attempt(service, action):
    """The result of an action on a service; its failure as one that may pass, or one that will not."""
    try:
        return action()
    except Exception as error:
        reason = str(error)
        if any(name in reason for name in ABSENT):
            raise _Later(f"no simulator has created service {service}", OPEN_PATIENCE_S) from error
        if any(name in reason for name in OCCUPIED):
            message = f"another process serves this lane (service {service}: {reason})"
            raise _Later(message, OCCUPIED_PATIENCE_S) from error
        if "IncompatibleTypes" in reason:
            reason = "its message types have other names or sizes than this package's"
        raise LinkError(f"cannot attach to service {service}: {reason}") from error


def schema_message(found):
    """What to tell a user whose two sides do not fit."""
    return (
        f"the run speaks link schema {found:#018x}, this package speaks {SCHEMA_HASH:#018x}: "
        "install the package that belongs to this hypogeum"
    )
