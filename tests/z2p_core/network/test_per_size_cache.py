"""Each size is prepared once, also by concurrent threads; the most recently used sizes are kept."""

import time
from concurrent.futures import ThreadPoolExecutor

from z2p_core.network.per_size_cache import MAX_CACHED_SIZES, cached_per_size


def test_each_size_is_made_once_and_the_oldest_dropped():
    made = []

    def make(size):
        time.sleep(0.02)
        made.append(size)
        return [size]

    get = cached_per_size(make)
    with ThreadPoolExecutor(8) as threads:
        results = list(threads.map(get, [1] * 8))
    assert made == [1] and all(one is results[0] for one in results)
    for size in range(2, MAX_CACHED_SIZES + 1):
        get(size)
    assert get(1) is results[0] and made == list(range(1, MAX_CACHED_SIZES + 1))
    get(MAX_CACHED_SIZES + 1)  # 2 was not used for longest
    assert get(1) is results[0] and get(2) == [2] and made[-1] == 2
