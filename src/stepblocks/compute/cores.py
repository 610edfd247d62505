"""How many processors this process may use."""


def count_cores() -> int:
    """Count the processors that this process may use: of the machine, its affinity and container.

    The environment variable ``LOKY_MAX_CPU_COUNT`` lowers it.
    """
    import joblib

    return int(joblib.cpu_count())
