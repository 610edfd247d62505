"""Who may ask the pages that this machine serves: what names it as its host, and comes from it."""

from collections.abc import Sequence


def comes_from_this_machine(hosts: Sequence[str], origins: Sequence[str], port: int) -> bool:
    """Tell whether the headers of a request name this machine, and no other page, without doubt.

    A name that a foreign page lets point at this machine must not open a page of it (DNS
    rebinding). Of a header that comes twice, what stands between may believe the other.

    Parameters
    ----------
    hosts, origins : sequence of str
        Every value of the headers ``Host`` and ``Origin``.
    port : int
        Where the page is served.
    """
    if len(hosts) != 1 or len(origins) > 1:
        return False
    host = hosts[0]
    if host not in (f"127.0.0.1:{port}", f"localhost:{port}"):
        return False
    return all(origin == f"http://{host}" for origin in origins)
