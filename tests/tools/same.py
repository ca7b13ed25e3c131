"""Results that are equal to the bit."""


def assert_same(one, other):
    """Assert that every variable of a result has the same bits in another one."""
    for name in one.data_vars:
        assert one[name].values.tobytes() == other[name].values.tobytes(), name
