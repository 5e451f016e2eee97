def report(folder):
    return ""


def tables(folder):
    return ""
