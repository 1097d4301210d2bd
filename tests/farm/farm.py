"""The cases of run.sh. Each prints what it has measured, and fails by an assertion."""

import argparse
import hashlib
import json
import os
import pathlib
import shutil
import signal
import subprocess
import sys
import tempfile
import time

import cluster
import models
import servers

COMMAND = os.environ["FARM_COMMAND"]
QUICK = ["--quality", "draft", "--faces", "100", "--set", "texture_size=64", "--set", "views=8", "--set", "view_size=128",
         "--set", "candidates=source"]


class Checkout:
    """A folder with a library, and a local cache of its own."""

    def __init__(self, case, name, number):
        self.folder, self.server = case / name, None
        models.library(self.folder / "assets", number)

    def run(self, *args, server=None, cache="cache", **more):
        """Runs the command; returns its exit code, its JSON document, its messages and its seconds."""
        env = servers.environment(server, **more) if server else dict(os.environ)
        env["SIMPLIGUARD_CACHE_DIR"] = str(self.folder / cache)
        if server:
            env["SIMPLIGUARD_SHARED_CACHE"] = server.address
        start = time.monotonic()
        done = subprocess.run([COMMAND, *args], cwd=self.folder, env=env, capture_output=True, text=True)
        document = json.loads(done.stdout) if done.stdout.startswith("{") else None
        return done.returncode, document, done.stderr, time.monotonic() - start

    def bake(self, *args, server=None, **more):
        return self.run("bake", "assets", "--json", *QUICK, *args, server=server, **more)

    def plan(self, *args, server=None, **more):
        code, document, errors, _ = self.run("farm", "plan", "assets", "--bundle", "bundle", "--json", *QUICK, *args,
                                             server=server, **more)
        assert code == 0, errors
        return document

    def outputs(self):
        """The hashes of all outputs."""
        folder = self.folder / "lods"
        return {str(p.relative_to(folder)): hashlib.sha256(p.read_bytes()).hexdigest() for p in folder.rglob("*.glb")}


def statuses(document):
    counts = {}
    for asset in document["assets"]:
        counts[asset["status"]] = counts.get(asset["status"], 0) + 1
    return counts


def two_checkouts(case, server, number):
    """A second checkout with an empty local cache bakes nothing."""
    first, second = (Checkout(case, name, number) for name in ("first", "second"))
    code, document, errors, _ = first.bake(server=server)
    assert code == 0 and statuses(document) == {"baked": number}, errors
    assert document["cache"]["shared"]["stored"] == number, document["cache"]
    code, document, errors, _ = second.bake(server=server)
    assert code == 0 and statuses(document) == {"hit": number}, errors
    assert document["cache"]["shared"]["hits"] == number
    assert first.outputs() == second.outputs()
    print(f"  the second checkout baked 0 of {number}; equal bytes")
    plan = second.plan(server=server)
    assert plan["hits"] == number and plan["tasks"] == 0, plan


def damaged(case, server, number):
    """Damage in the shared cache is found, baked again and replaced."""
    first = Checkout(case, "first", number)
    assert first.bake(server=server)[0] == 0
    objects, records = server.names("objects"), server.names("results")
    flipped = max(objects, key=lambda name: len(server.read(name)))
    content = bytearray(server.read(flipped))
    content[len(content) // 2] ^= 1
    server.write(flipped, bytes(content))
    cut = next(name for name in objects if name != flipped and server.read(name).startswith(b"glTF"))
    server.write(cut, server.read(cut)[:-9])
    swapped, other = records[0], records[1]
    server.write(swapped, server.read(other))
    second = Checkout(case, "second", number)
    code, document, errors, _ = second.bake(server=server)
    counts = statuses(document)
    assert code == 0 and 1 <= counts["baked"] <= 3 and counts["baked"] + counts["hit"] == number, (counts, errors)
    assert "does not match its hash" in errors and "bytes instead of" in errors and "of another key" in errors, errors
    assert document["cache"]["shared"]["damaged"] == counts["baked"], document["cache"]
    assert first.outputs() == second.outputs()
    third = Checkout(case, "third", number)
    code, document, errors, _ = third.bake(server=server)
    assert statuses(document) == {"hit": number} and "warning" not in errors, errors
    print(f"  a flipped bit, a truncated object, another's record: {counts['baked']} baked again, then replaced")


def outage(case, server, number):
    """A shared cache that stops in the middle of a run costs one warning."""
    first = Checkout(case, "first", number)
    env = servers.environment(server, SIMPLIGUARD_CACHE_DIR=str(first.folder / "cache"),
                              SIMPLIGUARD_SHARED_CACHE=server.address)
    process = subprocess.Popen([COMMAND, "bake", "assets", "--json", *QUICK], cwd=first.folder, env=env, text=True,
                               stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    lines = []
    for line in process.stderr:
        lines.append(line)
        if "baked in" in line:
            server.stop()
            break
    rest, errors = process.communicate()
    errors = "".join(lines) + errors
    server.start()
    assert process.returncode == 0 and statuses(json.loads(rest)) == {"baked": number}, errors
    warnings = errors.count("warning: shared cache")
    assert warnings <= 1, errors
    assert first.bake()[1]["cache"]["local"]["hits"] == number
    print(f"  stopped in the middle of a run: all baked and kept here, {warnings} warning")


def slow(case, server, number):
    """A shared cache with two seconds a request fails nothing, and what takes longer to bake is found there."""
    first, second = (Checkout(case, name, 0) for name in ("first", "second"))
    for checkout in (first, second):
        (checkout.folder / "assets").mkdir(parents=True)
        (checkout.folder / "assets" / "large.glb").write_bytes(models.sphere(130, 3))
    server.delay = 2.0
    code, document, errors, baked = first.run("bake", "assets", "--json", server=server)
    assert code == 0 and statuses(document) == {"baked": 1} and "warning" not in errors, errors
    assert document["cache"]["shared"]["stored"] == 1, document["cache"]
    code, document, errors, hit = second.run("bake", "assets", "--json", server=server)
    server.delay = 0.0
    assert code == 0 and statuses(document) == {"hit": 1} and "warning" not in errors, errors
    assert first.outputs() == second.outputs()
    print(f"  two seconds a request: baked and stored in {baked:.1f} s, found in {hit:.1f} s")


def stalled(case, server, number):
    """A shared cache that never answers costs one warning and less than a second."""
    first, second = (Checkout(case, name, number) for name in ("first", "second"))
    code, document, errors, alone = first.bake()
    assert code == 0 and statuses(document) == {"baked": number}, errors
    server.delay = 600.0
    code, document, errors, shared = second.bake(server=server)
    assert code == 0 and statuses(document) == {"baked": number}, errors
    assert errors.count("warning: shared cache") == 1 and "has not answered for" in errors, errors
    assert first.outputs() == second.outputs()
    print(f"  {number} models in {alone:.1f} s without, in {shared:.1f} s with a shared cache that never answers")


def read_only(case, server, number):
    """Credentials without the right to write: one warning, and hits go on."""
    first, second = (Checkout(case, name, 3) for name in ("first", "second"))
    assert first.bake(server=server)[0] == 0
    (second.folder / "assets" / "new.glb").write_bytes(models.sphere(15, 77))
    server.read_only = True
    code, document, errors, _ = second.bake(server=server)
    server.read_only = False
    assert code == 0 and statuses(document) == {"hit": 3, "baked": 1}, errors
    assert errors.count("warning: shared cache") == 1 and "is read, but not written" in errors, errors
    print("  read-only credentials: 3 hits, 1 baked and kept here, 1 warning")


def misconfigured(case, server, number):
    """An address that can never be used ends the command before a bake."""
    first = Checkout(case, "first", 1)
    for address in ["s3://no-such-bucket/x"] * (server.kind == "s3") + ["gopher://levels"]:
        code, _, errors, seconds = first.bake("--shared-cache", address, server=server)
        assert code == 2 and "cannot be used" in errors and not (first.folder / "lods").exists(), errors
        print(f"  {address}: refused in {seconds:.1f} s")


def signatures(case, server, number):
    """Unsigned records are misses for a machine with trusted keys, until a build machine signs them."""
    first = Checkout(case, "first", 3)
    assert first.bake(server=server)[0] == 0
    key = case / "key"
    public = subprocess.run([COMMAND, "cache", "keygen", str(key)], capture_output=True, text=True, check=True).stdout
    trusted = {"SIMPLIGUARD_TRUSTED_KEYS": public.strip()}
    build, artist = (Checkout(case, name, 3) for name in ("build", "artist"))
    code, document, errors, _ = build.bake(server=server, SIMPLIGUARD_SIGNING_KEY=str(key), **trusted)
    assert code == 0 and statuses(document) == {"baked": 3}, errors
    assert document["cache"]["shared"]["untrusted"] == 3, document["cache"]
    code, document, errors, _ = artist.bake(server=server, **trusted)
    assert code == 0 and statuses(document) == {"hit": 3} and "warning" not in errors, errors
    print("  3 unsigned records: 3 untrusted, baked and signed; then 3 hits")


def one_cache(case, server, number):
    """Sixteen processes on one local cache bake each key once."""
    checkout = Checkout(case, "first", number)
    env = {**os.environ, "SIMPLIGUARD_CACHE_DIR": str(checkout.folder / "cache")}
    processes = [subprocess.Popen([COMMAND, "bake", "assets", "--json", "--threads", "1", "--output", f"out{n}", *QUICK],
                                  cwd=checkout.folder, env=env, text=True, stdout=subprocess.PIPE,
                                  stderr=subprocess.DEVNULL) for n in range(16)]
    documents = [json.loads(process.communicate()[0]) for process in processes]
    baked = sum(statuses(document).get("baked", 0) for document in documents)
    assert all(process.returncode == 0 for process in processes) and baked == number, baked
    print(f"  16 processes, {number} models each: {baked} bakes in total")


def openjd(case, server, number):
    """`openjd run` executes the bundle; the second plan is empty."""
    checkout = Checkout(case, "first", number)
    plan = checkout.plan("--task-time", "20s", server=server)
    assert plan["misses"] == number, plan
    subprocess.run(["openjd", "check", "bundle/template.yaml"], cwd=checkout.folder, check=True,
                   stdout=subprocess.DEVNULL)
    code, report, errors, seconds = checkout.run("farm", "run", "--local", "--bundle", "bundle", "--json", server=server)
    assert code == 0 and report["done"] == number and report["baked"] == number, (report, errors)
    again = checkout.plan(server=server, cache="another")
    assert again["misses"] == 0 and again["tiers"]["shared"] == number and again["tasks"] == 0, again
    alone = Checkout(case, "alone", number)
    assert alone.bake()[0] == 0
    assert checkout.bake(server=server)[0] == 0 and checkout.outputs() == alone.outputs()
    print(f"  {plan['tasks']} tasks by openjd in {seconds:.0f} s; second plan empty; equal to one process")


def submitted(farm, store, slurm, *flags):
    """Submits the plan of a checkout to Slurm; returns the function that waits for it and tells its seconds and its report."""
    env = servers.environment(store, SIMPLIGUARD_SHARED_CACHE=store.address, **slurm.environment,
                              SIMPLIGUARD_CACHE_DIR=str(farm.folder / "cache"))
    start = time.monotonic()
    submit = [COMMAND, "farm", "submit", "--slurm", "--bundle", "bundle", *flags]
    job = subprocess.run(submit, cwd=farm.folder, env=env, capture_output=True, text=True)
    assert job.returncode == 0, job.stderr

    def wait():
        slurm.wait(1200)
        seconds = time.monotonic() - start
        code, report, errors, _ = farm.run("farm", "status", "--bundle", "bundle", "--json", server=store)
        assert code == 0 and report["done"] == report["assets"], (report, errors)
        return seconds, report

    return wait


ONE_CORE = ["--worker-cpus", "1", "--worker-memory", "1GiB"]


def slurm(case, server, number):
    """Slurm with two workers: equal bytes, and one of them killed in the middle of an array."""
    alone = Checkout(case, "alone", number)
    assert alone.bake()[0] == 0
    with cluster.Slurm(case / "slurm") as slurm:
        for killed in (False, True):
            farm = Checkout(case, "killed" if killed else "two", number)
            store = servers.open_server("folder", farm.folder / "store", None) if killed else server
            plan = farm.plan("--task-time", "1s", *ONE_CORE, server=store)
            wait = submitted(farm, store, slurm)
            lost = 0
            if killed:
                slurm.wait_for_running(2)
                lost = len(slurm.kill("n2"))
            seconds, report = wait()
            # A task that is killed between its bake and its report has baked a model that is a hit for the next try.
            again = number - report["baked"]
            assert 0 <= again <= lost, (report, lost)
            assert farm.bake(server=store)[0] == 0 and farm.outputs() == alone.outputs()
            what = f"one worker killed with {lost} task" if killed else "two workers"
            print(f"  {what}: {plan['tasks']} tasks in {seconds:.0f} s, {report['baked']} reported as baked; equal to one "
                  f"process")


def throughput(case, server, number):
    """Two workers of one core each bake at least 1.7 times as fast as one."""
    seconds = {}
    with cluster.Slurm(case / "slurm") as slurm:
        for workers, flags in [(1, ["--", "--nodelist=n1"]), (2, [])]:
            farm = Checkout(case, f"workers{workers}", number)
            for n, path in enumerate(sorted((farm.folder / "assets").rglob("*.glb"))):
                path.write_bytes(models.sphere(96, 1000 * workers + n))
            plan = farm.plan("--task-time", "1s", *ONE_CORE, server=server)
            assert plan["tasks"] == number, plan
            seconds[workers], _ = submitted(farm, server, slurm, *flags)()
    ratio = seconds[1] / seconds[2]
    print(f"  {number} tasks: {seconds[1]:.0f} s with one worker, {seconds[2]:.0f} s with two: {ratio:.2f} times as fast")
    assert ratio >= 1.7, ratio


def overhead(case, server, number):
    """What the shared cache costs on a hit here, a hit there and a miss."""
    def median(run):
        return sorted(run() for _ in range(5))[2]

    def empty(checkout):
        shutil.rmtree(checkout.folder / "cache", ignore_errors=True)

    checkout = Checkout(case, "first", number)
    assert checkout.bake(server=server)[0] == 0

    def warm(shared):
        return median(lambda: checkout.bake(server=shared)[3]) / number

    def fetched():
        empty(checkout)
        return checkout.bake(server=server)[3]

    print(f"  local hit {1000 * warm(None):.1f} ms a model; with the shared cache {1000 * warm(server):.1f} ms")
    print(f"  hit in the shared cache {1000 * median(fetched) / number:.1f} ms a model")
    empty(checkout)
    code, document, errors, seconds = checkout.bake(server=server)
    shared = document["cache"]["shared"]
    print(f"  fetched: {shared['requests'] / number:.1f} requests and {shared['bytes_read'] / number / 1024:.0f} KiB a model")
    seconds = {}
    for name, store in [("alone", None), ("shared", server)]:
        times = []
        for n in range(3):
            fresh = Checkout(case, f"{name}{n}", number)
            for path in (fresh.folder / "assets").rglob("*.glb"):
                path.write_bytes(models.sphere(14, 1000 + 100 * n + hash_of(path.name, name)))
            code, document, errors, time_ = fresh.bake(server=store)
            assert statuses(document) == {"baked": number}, errors
            times.append(time_)
        seconds[name] = sorted(times)[1] / number
    shared = document["cache"]["shared"]
    print(f"  miss: {seconds['alone']:.3f} s a model without, {seconds['shared']:.3f} s with the shared cache; "
          f"{shared['requests'] / number:.1f} requests and {shared['bytes_written'] / number / 1024:.0f} KiB written a model")


def hash_of(*parts):
    return int(hashlib.sha256("/".join(parts).encode()).hexdigest()[:6], 16)


CASES = [two_checkouts, damaged, outage, slow, stalled, read_only, misconfigured, signatures, one_cache, openjd, slurm, throughput,
         overhead]
# What a folder cannot do.
NEEDS_S3 = {slow, stalled, read_only}


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--tier", choices=["s3", "folder"], default="s3")
    parser.add_argument("--models", type=int, default=12)
    parser.add_argument("cases", nargs="*", choices=[[], *[case.__name__ for case in CASES]])
    args = parser.parse_args()
    chosen = [case for case in CASES if not args.cases or case.__name__ in args.cases]
    with tempfile.TemporaryDirectory(prefix="simpliguard-farm-") as root:
        for case in chosen:
            if args.tier == "folder" and case in NEEDS_S3:
                print(f"{case.__name__}: skipped, it needs --tier s3")
                continue
            folder = pathlib.Path(root) / case.__name__
            folder.mkdir()
            with open(folder / "server.log", "w") as log:
                server = servers.open_server(args.tier, folder / "server", log)
                print(f"{case.__name__}: {case.__doc__}", flush=True)
                start = time.monotonic()
                try:
                    case(folder, server, args.models)
                finally:
                    server.close()
                print(f"  ok in {time.monotonic() - start:.0f} s", flush=True)
            shutil.rmtree(folder, ignore_errors=True)


if __name__ == "__main__":
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))
    main()
