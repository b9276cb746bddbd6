import os

source, target, problem = (os.environ["ISOMARK_" + name] for name in ("FROM", "TO", "PROBLEM"))
end = 1
try:
    try:
        import resource
        import signal

        # The limits hold also when isomark is killed.
        memory, size = int(os.environ["ISOMARK_MEMORY"]), int(os.environ["ISOMARK_SIZE"])
        resource.setrlimit(resource.RLIMIT_AS, (memory, memory))
        resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))
        signal.alarm(int(os.environ["ISOMARK_SECONDS"]))
    except ImportError:
        pass  # On Windows, isomark alone enforces the limits.
    import Part

    shape = Part.Shape()
    shape.read(source)
    shape.toNurbs().exportStep(target)
    end = 0
except BaseException as error:
    with open(problem, "w", encoding="utf-8") as out:
        out.write(f"{type(error).__name__}: {error}")
os._exit(end)
