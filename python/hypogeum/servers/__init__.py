"""Policies that live in a server of another project: what its protocols have in common.

`hypogeum.openpi`, `hypogeum.vla_eval` and `hypogeum.lerobot_async` are the protocols. Each gives `ServerPolicy` an
object with these methods, of which `open` and `ask` raise the errors in `answers`:

- `prepare(requests)`: takes note of the `Requests` of a run;
- `encode(requests, envs)`: the messages for some envs, which refer to no array of the observation;
- `open(slots, deadline)`: connects what these slots need, and returns what the server says of itself;
- `ask(slots, messages, deadline)`: sends the messages and returns one array of actions each;
- `close()`: closes all connections.
"""
