"""Numbers of things in words."""


def counted(number: int, noun: str) -> str:
    """How many there are.

    >>> counted(1, "gap"), counted(3, "pair of spheres")
    ('1 gap', '3 pairs of spheres')
    """
    first, *rest = noun.split(" ", 1)
    return " ".join([str(number), first + "s" * (number != 1), *rest])
