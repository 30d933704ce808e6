"""Command line of `python -m hypogeum.lerobot`."""

import argparse
import logging
import sys
from pathlib import Path

from ..requirements import explained
from . import __doc__ as description

INSTALL = "pip install './python[lerobot]'"


def arguments(argv):
    parser = argparse.ArgumentParser(prog="python -m hypogeum.lerobot", description=description.split("\n")[0])
    parser.add_argument("name", help="NAME of `hypogeum run --policy ...=attach:NAME`")
    parser.add_argument("checkpoint", help="checkpoint saved by LeRobot, or a folder of lerobot-train for its last one")
    parser.add_argument("--device", default="cpu", help="torch device (default: cpu)")
    batch = "compute all envs as one batch: faster, above all on a GPU, but rounding may depend on the batch size"
    parser.add_argument("--batch", action="store_true", help=batch)
    parser.add_argument("--batched", action="store_true", dest="batch", help=argparse.SUPPRESS)
    parser.add_argument("--threads", type=int, help="number of torch threads")
    parser.add_argument("--forever", action="store_true", help="serve the next run when one ends")
    parser.add_argument("--base", type=Path, help="folder that contains the runs")
    parser.add_argument("--timeout", type=float, metavar="S", help="exit if no run appears within S seconds")
    return parser.parse_args(argv)


def main(argv=None):
    args = arguments(argv)
    with explained(INSTALL):
        serve_checkpoint(args)


def serve_checkpoint(args):
    """Serve a checkpoint as the command line says; exits with the reason if that is impossible."""
    import torch

    from ..endpoint import EndpointError
    from ..execution import RunRefused
    from ..host import serve
    from ..link import LinkError
    from ..mapping import MappingError
    from .policy import LeRobotPolicy

    # LeRobot's dependencies configure logging when they are imported.
    logging.basicConfig(level=logging.INFO, format="%(message)s", force=True)
    if args.threads:
        torch.set_num_threads(args.threads)
    try:
        policy = LeRobotPolicy(args.checkpoint, args.device, args.batch)
        options = dict(base=args.base, timeout_s=args.timeout, forever=args.forever)
        print(serve(policy, args.name, ensemble_coeff=policy.ensemble_coeff, **options))
    except (EndpointError, LinkError, MappingError, RunRefused, TimeoutError) as error:
        sys.exit(f"error: {error}")
    except KeyboardInterrupt:
        sys.exit(130)


if __name__ == "__main__":
    main()
