"""Policy host's end of a lane. No other module of this package uses iceoryx2.

Two services carry pages, `observation` to the host and `action` back; one event per direction wakes the receiver. The
simulator creates them. The host opens them after verifying the properties that both sides must agree on.
"""

import ctypes
import os
import shutil
import time
from pathlib import Path

import iceoryx2 as iox
import numpy as np

from .checksum import checksum
from .endpoint import LOCK_NAME, schema_message
from .layout import ACTION_BLOCK, PAGE_BYTES, SCHEMA_HASH, ActionHeader, ObservationHeader, Page
from .segment import Segment, SegmentGone
from .trust import is_run, own_segments

SHM = Path("/dev/shm")
IPC = iox.ServiceType.Ipc
# Pages of an env's answer.
ACTION_PAGES = ACTION_BLOCK.itemsize // PAGE_BYTES
# Event that wakes the simulator, shared by all its lanes, and the only event id in use.
SIM_WAKE = "hyp/sim/wake"
WAKE_EVENT = 0
# Maximum wait for a simulator to create the lane, and for another host to detach from it.
OPEN_TIMEOUT_S = 60.0
OCCUPIED_TIMEOUT_S = 5.0
# Maximum wait for the simulator to release memory for answers.
LOAN_TIMEOUT_S = 1.0
RETRY_INTERVAL_S = 0.005

# iceoryx2 errors that mean that a service does not exist yet, or that another process holds its only port.
ABSENT = ("DoesNotExist", "HangsInCreation", "IsMarkedForDestruction", "Interrupt")
OCCUPIED = (
    "ExceedsMaxNumberOfNodes",
    "ExceedsMaxSupportedListeners",
    "ExceedsMaxSupportedNotifiers",
    "ExceedsMaxSupportedPublishers",
    "ExceedsMaxSupportedSubscribers",
)


class LinkError(Exception):
    """A failed operation of the link."""


class RunEnded(Exception):
    """The run has ended."""


class _TransientError(Exception):
    """A failure after which another attempt may succeed, until `timeout_s` has passed."""

    def __init__(self, message, timeout_s):
        super().__init__(message)
        self.timeout_s = timeout_s


class Message:
    """A received observation message. The simulator cannot reuse its memory until it is released."""

    def __init__(self, sample, header, pages):
        self.header = header
        """Copy of the `ObservationHeader`."""
        self.pages = pages
        """`[n_bytes] u8`, read-only, in shared memory."""
        self._sample = sample

    def release(self):
        self.pages = None
        self._sample.delete()


class Lane:
    """Connection to a lane, attached from construction to `close`."""

    def __init__(self, endpoint):
        """Attach to the lane of an `EndpointDescriptor`.

        Waits for the simulator to create the lane and for the lane's previous host to detach.

        Raises:
            RunEnded: The run ended before the lane could be opened.
            LinkError: The wait timed out, the two sides are incompatible, or iceoryx2 failed.
        """
        self.endpoint = endpoint
        self._segment = None
        # Everything iceoryx2 logs is either raised as well or expected when a run ends while we are attached.
        iox.set_log_level_from_env_or(iox.LogLevel.Fatal)
        try:
            self._node = join(endpoint)
            self._open_with_retries()
        except BaseException:
            self.close()
            raise

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()

    def close(self):
        """Detach from the lane and remove the files of a run that has ended."""
        self._drop_ports()
        self._segment = self._node = None
        self._remove_if_stale()

    def receive(self):
        """Return the oldest unread `Message`, or None if there is none. Never blocks."""
        sample = self._observations.receive()
        if sample is None:
            return None
        n_pages = sample.header.number_of_elements
        max_pages = self.endpoint.max_envs * self.endpoint.block_pages
        if n_pages > max_pages:
            sample.delete()
            raise LinkError(f"received a message that claims {n_pages} pages; this lane allows at most {max_pages}")
        header = ObservationHeader.from_buffer_copy(ctypes.string_at(sample.user_header_ptr, 64))
        try:
            pages = self._pages(sample, n_pages * PAGE_BYTES)
        except SegmentGone:
            # The sender has exited, so no process waits for an answer.
            sample.delete()
            return None
        return Message(sample, header, pages)

    def has_message(self):
        """Return whether `receive` would return a message."""
        return self._observations.has_samples()

    def wait(self, timeout_s):
        """Wait until the simulator notifies this host, a signal arrives, or the timeout has passed."""
        try:
            self._listener.timed_wait(iox.Duration.from_secs_f64(timeout_s))
        except iox.ListenerWaitError as error:
            if "InterruptSignal" not in str(error):
                raise LinkError(f"failed to wait for the simulator: {error}") from error

    def reply(self, message, status, fill):
        """Answer a message and release it.

        Args:
            message: The `Message` to answer.
            status: 0 on success, 1 if the policy failed, 2 if the observation was damaged.
            fill: Function that writes the answer into zeroed blocks, `[n_envs] ACTION_BLOCK`.
        """
        n_envs = min(max(message.header.n_envs, 1), self.endpoint.max_envs)
        loan = self._loan(n_envs * ACTION_PAGES)
        n_bytes = n_envs * ACTION_BLOCK.itemsize
        ctypes.memset(loan.payload_ptr, 0, n_bytes)
        fill(np.frombuffer((ctypes.c_uint8 * n_bytes).from_address(loan.payload_ptr), ACTION_BLOCK))
        query = message.header
        header = ActionHeader(SCHEMA_HASH, query.run, query.sequence, query.epoch, n_envs, status)
        if query.has_checksum:
            header.has_checksum = 1
            header.checksum = checksum(header, (ctypes.c_uint8 * n_bytes).from_address(loan.payload_ptr))
        ctypes.memmove(loan.user_header_ptr, ctypes.addressof(header), ctypes.sizeof(header))
        message.release()
        try:
            # No receiver is not an error: if the simulator has exited, its successor repeats the query.
            loan.assume_init().send()
        except iox.SendError as error:
            raise LinkError(f"failed to send an answer: {error}") from error
        self._notify()

    def _open_with_retries(self):
        start = time.monotonic()
        while True:
            try:
                return self._open()
            except _TransientError as error:
                self._drop_ports()
                if not self.endpoint.run_is_alive():
                    raise RunEnded from None
                if time.monotonic() - start >= error.timeout_s:
                    raise LinkError(str(error)) from None
                self._node.try_cleanup_dead_nodes()
                time.sleep(RETRY_INTERVAL_S)

    def _open(self):
        lane = f"hyp/lane/{self.endpoint.lane}"
        observation, action, wake = f"{lane}/observation", f"{lane}/action", f"{lane}/wake"
        for service in (observation, action):
            self._check_agreement(service)
        observations = self._open_messages(observation, ObservationHeader)
        actions = self._open_messages(action, ActionHeader)
        host_wake = self._open_event(wake)
        notifier = self._open_event(SIM_WAKE).notifier_builder().default_event_id(iox.EventId.new(WAKE_EVENT))
        self._listener = attempt(wake, host_wake.listener_builder().create)
        self._notifier = attempt(SIM_WAKE, notifier.create)
        publisher = (
            actions.publisher_builder()
            .initial_max_slice_len(self.endpoint.max_envs * ACTION_PAGES)
            .allocation_strategy(iox.AllocationStrategy.Static)
            .max_loaned_samples(1)
            # The simulator's queue has room for all queries in flight: only an exited one's can be full.
            .backpressure_strategy(iox.BackpressureStrategy.DiscardData)
        )
        self._actions = attempt(action, publisher.create)
        self._reserve(self._actions.id.value)
        # Last: from here on the simulator considers the host attached, so everything else must be in place.
        self._observations = attempt(observation, observations.subscriber_builder().create)

    def _drop_ports(self):
        for name in ("_observations", "_actions", "_listener", "_notifier"):
            port = self.__dict__.pop(name, None)
            if port is not None:
                port.delete()

    def _check_agreement(self, service):
        """Compare a service's attributes with the endpoint descriptor; they explain a mismatch better than types do."""
        name = iox.ServiceName.new(service)
        try:
            details = iox.Service.details(name, self._node.config, iox.MessagingPattern.PublishSubscribe, IPC)
        except iox.ServiceDetailsError as error:
            raise _TransientError(f"failed to inspect service {service}: {error}", OPEN_TIMEOUT_S) from error
        if details is None:
            raise _TransientError(f"no simulator has created service {service}", OPEN_TIMEOUT_S)
        values = {attribute.key.to_string(): attribute.value.to_string() for attribute in details.attributes().values}
        endpoint = self.endpoint
        expected = {
            "schema": f"{SCHEMA_HASH:016x}",
            "lane": str(endpoint.lane),
            "policy": endpoint.policy,
            "max_envs": str(endpoint.max_envs),
            "block_pages": str(endpoint.block_pages),
            "in_flight": str(endpoint.in_flight),
        }
        for field, value in expected.items():
            found = values.get(field, "absent")
            if found == value:
                continue
            if field == "schema" and found != "absent":
                raise LinkError(schema_message(int(found, 16)))
            raise LinkError(f"failed to attach to service {service}: its {field} is {found}, expected {value}")

    def _open_messages(self, service, header):
        builder = self._node.service_builder(iox.ServiceName.new(service))
        return attempt(service, builder.publish_subscribe(iox.Slice[Page]).user_header(header).open)

    def _open_event(self, service):
        return attempt(service, self._node.service_builder(iox.ServiceName.new(service)).event().open)

    def _reserve(self, publisher_id):
        """Reserve the memory of all answers, so that a full /dev/shm is an error now instead of a SIGBUS later."""
        suffix = f"_{publisher_id}.data"
        for path in own_segments(SHM, self.endpoint.prefix):
            if not path.name.endswith(suffix):
                continue
            file = os.open(path, os.O_RDWR | os.O_CLOEXEC | os.O_NOFOLLOW)
            try:
                os.posix_fallocate(file, 0, os.fstat(file).st_size)
            except OSError as error:
                raise LinkError(f"failed to reserve memory for answers in {SHM} ({error}); enlarge it") from error
            finally:
                os.close(file)

    def _pages(self, sample, n_bytes):
        # A new simulator's memory may be mapped at the same addresses as its predecessor's.
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
                if "OutOfMemory" not in str(error) or time.monotonic() - start > LOAN_TIMEOUT_S:
                    raise LinkError(f"failed to loan memory for {n_pages} answers: {error}") from error
                # Reclaims the messages that an exited simulator held.
                self._actions.update_connections()
                time.sleep(RETRY_INTERVAL_S)

    def _notify(self):
        try:
            self._notifier.notify()
        except iox.NotifierNotifyError:
            # A lost notification is not an error, because every wait has a timeout.
            pass

    def _remove_if_stale(self):
        """Remove the files of a run that ended while we were joining or leaving, as its missing lock file shows."""
        root = self.endpoint.root
        if (root / LOCK_NAME).exists():
            return
        for path in own_segments(SHM, self.endpoint.prefix):
            path.unlink(missing_ok=True)
        if is_run(root):
            shutil.rmtree(root, ignore_errors=True)


def join(endpoint):
    """Join the domain of a run and return this process's node. Reads none of iceoryx2's configuration files."""
    config = iox.config.default()
    config.global_cfg.prefix = iox.FileName.new(endpoint.prefix)
    config.global_cfg.root_path = iox.Path.new(str(endpoint.root))
    builder = iox.NodeBuilder.new().name(iox.NodeName.new("python policy host")).config(config)
    try:
        return builder.signal_handling_mode(iox.SignalHandlingMode.Disabled).create(IPC)
    except iox.NodeCreationFailure as error:
        if not endpoint.run_is_alive():
            raise RunEnded from error
        raise LinkError(f"failed to join the run in {endpoint.root}: {error}") from error


def attempt(service, action):
    """Return the result of an action on a service, translating its errors.

    Raises:
        _TransientError: Another attempt may succeed.
        LinkError: No further attempt can succeed.
    """
    try:
        return action()
    except Exception as error:
        reason = str(error)
        if any(name in reason for name in ABSENT):
            raise _TransientError(f"no simulator has created service {service}", OPEN_TIMEOUT_S) from error
        if any(name in reason for name in OCCUPIED):
            message = f"another process already serves this lane (service {service}: {reason})"
            raise _TransientError(message, OCCUPIED_TIMEOUT_S) from error
        if "IncompatibleTypes" in reason:
            reason = "its message types differ in name or size from those of this package"
        raise LinkError(f"failed to attach to service {service}: {reason}") from error
