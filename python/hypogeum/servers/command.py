"""Command line of `python -m hypogeum.PROTOCOL URL NAME`."""

import argparse
import logging
import os
import signal
import sys
import threading
import time
from pathlib import Path
from urllib.parse import urlsplit, urlunsplit

from ..mapping import MappingError

# Exit code of a run's child for an error that the user can fix.
USER_ERROR = 2
# Time to leave a lane.
LEAVE_S = 2.0


def make_parser(protocol, description, schemes):
    """Return the parser of a protocol's command line with the options of all protocols.

    Args:
        protocol: Name of the module.
        description: Its documentation, of which the first line is shown.
        schemes: What may stand before `://` in an address.
    """
    parser = argparse.ArgumentParser(prog=f"python -m hypogeum.{protocol}", description=description.split("\n")[0])
    parser.set_defaults(schemes=schemes)
    parser.add_argument("url", metavar="URL", help=f"address of the server, {schemes[0]}://HOST:PORT")
    parser.add_argument("name", metavar="NAME", help="NAME of `hypogeum run --policy ...=attach:NAME`")
    parser.add_argument("--mapping", type=Path, metavar="FILE", help="request in the syntax of hypogeum.json")
    connect = "exit if the server cannot be reached within S seconds (default: %(default)g)"
    parser.add_argument("--connect", type=float, metavar="S", default=60.0, help=connect)
    parser.add_argument("--forever", action="store_true", help="serve the next run when one ends")
    parser.add_argument("--base", type=Path, help="folder that contains the runs")
    parser.add_argument("--timeout", type=float, metavar="S", help="exit if no run appears within S seconds")
    describe = "connect, print what the server says of itself, and exit"
    parser.add_argument("--describe", action="store_true", help=describe)
    # For a run that has started this program: it learns when the host is ready, and closes stdin to end it.
    parser.add_argument("--supervised", action="store_true", help=argparse.SUPPRESS)
    return parser


def parse_url(url, schemes):
    """Return the parts of an address, or raise `MappingError`. WebSockets have default ports."""
    parts = urlsplit(url)
    try:
        is_valid = parts.scheme in schemes and parts.hostname and (parts.port or "ws" in schemes)
    except ValueError:
        is_valid = False
    if not is_valid:
        expected = " or ".join(f"{scheme}://HOST:PORT" for scheme in schemes)
        raise MappingError(f"{without_credentials(url)!r} is no address of a server, expected {expected}")
    return parts


def without_credentials(url):
    """Return an address without user, password and query, for messages."""
    parts = urlsplit(url)
    return urlunsplit(parts._replace(netloc=parts.netloc.rpartition("@")[2], query="", fragment=""))


def serve_server(args, make_server, default):
    """Serve the policy in a server as the command line says; exits with the reason if that is impossible.

    Args:
        args: Parsed arguments.
        make_server: Function from the address's parts and the settings to the protocol's object.
        default: Function from a morphology's name to its mapping if no file gives one.
    """
    from ..endpoint import EndpointError
    from ..execution import RunRefused
    from ..host import PolicyLost, serve
    from ..link import LinkError
    from .policy import ServerPolicy
    from .requests import read_mapping

    logging.basicConfig(level=logging.WARNING, format="%(message)s", force=True)
    logging.getLogger("hypogeum").setLevel(logging.INFO)
    if args.supervised:
        threading.Thread(target=exit_with_stdin, daemon=True).start()
    policy = None
    try:
        parts = parse_url(args.url, args.schemes)
        settings = {} if args.mapping is None else read_mapping(args.mapping)
        policy = ServerPolicy(
            make_server(parts, settings), without_credentials(args.url), settings, default, args.connect
        )
        if args.describe:
            print(policy.connect())
            return
        policy.connect()
        on_ready = tell_run if args.supervised else None
        options = dict(base=args.base, timeout_s=args.timeout, forever=args.forever, on_ready=on_ready)
        statistics = serve(policy, args.name, **options)
        print(statistics, file=sys.stderr if args.supervised else sys.stdout)
    except (EndpointError, LinkError, MappingError, PolicyLost, RunRefused, TimeoutError) as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(USER_ERROR if args.supervised else 1)
    except KeyboardInterrupt:
        sys.exit(130)
    finally:
        if policy is not None:
            policy.server.close()


def tell_run():
    """Tell the run that has started this program that the host is ready, as its own hosts do."""
    print('{"Ready":{"load_ms":0.0}}', flush=True)


def exit_with_stdin():
    """End this process when nobody holds the other end of its standard input anymore."""
    # Past the interpreter's buffer, which it could not lock at its own end.
    while os.read(sys.stdin.fileno(), 1):
        pass
    # Like Ctrl-C, so that the host leaves its lane, unless a call does not return.
    os.kill(os.getpid(), signal.SIGINT)
    time.sleep(LEAVE_S)
    os._exit(1)
