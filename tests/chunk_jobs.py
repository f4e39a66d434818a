"""Jobs of chunks that are quick, slow, or fail: workers import them by name."""

import time

import numpy as np

from roadmap.builds.chunks import Chunk, Job


def same(spec):
    return spec


def squares(seconds, x):
    time.sleep(seconds)
    return x * x, np.array([len(x)])


def not_seven(_, x):
    if (x == 7).any():
        raise ValueError("it is seven")
    return (x,)


def job(function, spec=0.0):
    return Job(f"chunk_jobs:{function}", "chunk_jobs:same", spec, "number", 1)


def chunks(n=40, size=4):
    x = np.arange(float(n))
    return [Chunk(k, (x[k : k + size],)) for k in range(0, n, size)]
