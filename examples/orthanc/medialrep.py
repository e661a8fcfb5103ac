"""Orthanc hook for a medialrep that cannot reach Orthanc (a firewall that lets out and not in): every series of
segmentations that has come to rest is sent, its job is waited for, and the results are stored in Orthanc.

A series whose results are stored is marked (metadata "medialrep": what became of it, and the series' LastUpdate at
that time). Everything else waits in memory and is tried again at growing distances; what a stopped Orthanc forgot is
found by its missing mark at the next start. Sending twice gives the same job, and storing twice keeps one instance.

Nothing here logs what is in a file: the ids of Orthanc are hashes.
"""

import hashlib
import json
import ssl
import threading
import time
import urllib.error
import urllib.request

import orthanc

MARK = "medialrep"
RESULTS = ("picture.dcm", "report.pdf.dcm", "report.sr.dcm", "surfaces.stl.dcm")
# Series at the same time. More: Orthanc's own clients wait for its database. One: a long job holds up short ones.
THREADS = 2
# Seconds after the first failure, doubled with each one up to the last. Smaller: a service that is away is asked for
# nothing. Larger: results wait although it is back.
FIRST_WAIT, LAST_WAIT = 5, 300
# Seconds that the service may hold back its answer about a job; proxies cut off what is silent for a minute.
LONG_POLL = 20
# Longest silence of the service, seconds.
TIMEOUT = 60
# Statuses that are about the file, not about the service, the way to it, or the token.
ABOUT_THE_FILE = (400, 413, 415, 422)


class Refused(Exception):
    """The service will never take this file."""


class Erased(Exception):
    """The results of the job were kept long enough."""


class Later(Exception):
    """Something that may be otherwise in a while."""


class NoRedirect(urllib.request.HTTPRedirectHandler):
    """The token goes to the service that was named, and to no other."""

    def redirect_request(self, *_):
        return None


class Service:
    """The routes of medialrep that are needed."""

    def __init__(self, settings):
        self.url = settings["Url"].rstrip("/")
        with open(settings["TokenFile"], encoding="ascii") as file:
            self.token = file.readline().strip()
        context = ssl.create_default_context(cafile=settings.get("CaFile"))
        self.opener = urllib.request.build_opener(
            NoRedirect, urllib.request.ProxyHandler({}), urllib.request.HTTPSHandler(context=context)
        )

    def submit(self, body, key):
        """The job of a file. The same bytes under the same key are the same job."""
        headers = {"Content-Type": "application/dicom", "Idempotency-Key": key}
        return json.loads(self.call("POST", "/v1/jobs", body, headers))

    def wait(self, job):
        """The job once it has ended."""
        while job["state"] in ("queued", "running") and not stopping.is_set():
            job = json.loads(self.call("GET", f"/v1/jobs/{job['id']}?wait={LONG_POLL}"))
        return job

    def result(self, job, name):
        return self.call("GET", f"/v1/jobs/{job['id']}/results/{name}")

    def call(self, method, path, body=None, headers=None):
        request = urllib.request.Request(self.url + path, body, headers or {}, method=method)
        request.add_header("Authorization", "Bearer " + self.token)
        try:
            with self.opener.open(request, timeout=TIMEOUT) as answer:
                return answer.read()
        except urllib.error.HTTPError as error:
            code = problem_code(error)
            if error.code == 410:
                raise Erased from error
            if method == "POST" and error.code in ABOUT_THE_FILE and code:
                raise Refused(code) from error
            raise Later(code or f"status {error.code}") from error
        except (OSError, ValueError) as error:
            raise Later(type(error).__name__) from error


def problem_code(error):
    """The code of a problem object of medialrep's; none where a proxy answered in its place."""
    try:
        return str(json.loads(error.read())["code"])
    except (OSError, ValueError, KeyError, TypeError):
        return None


class Waiting:
    """Series that are to be sent, and when."""

    def __init__(self):
        self.changed = threading.Condition()
        self.due = {}
        self.tries = {}
        self.under_way = set()

    def add(self, series):
        with self.changed:
            self.due[series] = time.monotonic()
            self.changed.notify()

    def take(self):
        """Waits for the next one that is due and that nobody works on; none when Orthanc stops."""
        with self.changed:
            while not stopping.is_set():
                now = time.monotonic()
                free = [(due, series) for series, due in self.due.items() if series not in self.under_way]
                due, series = min(free, default=(now + LAST_WAIT, None))
                if due <= now:
                    del self.due[series]
                    self.under_way.add(series)
                    return series
                self.changed.wait(due - now)
        return None

    def done(self, series):
        with self.changed:
            self.under_way.discard(series)
            self.tries.pop(series, None)
            self.changed.notify()

    def later(self, series):
        """Seconds until it is tried again."""
        with self.changed:
            tries = self.tries[series] = self.tries.get(series, -1) + 1
            wait = min(FIRST_WAIT * 2 ** min(tries, 16), LAST_WAIT)
            self.under_way.discard(series)
            # It may have grown meanwhile and be due already.
            self.due.setdefault(series, time.monotonic() + wait)
            self.changed.notify()
            return wait

    def stop(self):
        with self.changed:
            self.changed.notify_all()


stopping = threading.Event()
waiting = Waiting()


def get(path):
    """What Orthanc says; none for what is not there any more."""
    try:
        return orthanc.RestApiGet(path)
    except orthanc.OrthancException:
        return None


def look(series):
    """Instances, time of the last one and mark of a series; none if it is no segmentation, one of ours, or gone."""
    answer, metadata = get(f"/series/{series}"), get(f"/series/{series}/metadata?expand")
    if answer is None or metadata is None:
        return None
    answer, metadata = json.loads(answer), json.loads(metadata)
    tags = answer["MainDicomTags"]
    if tags.get("Modality") != "SEG" or tags.get("Manufacturer") == "medialrep":
        return None
    return answer["Instances"], metadata["LastUpdate"], metadata.get(MARK, "")


def bring_back(service, instance):
    """Sends an instance and stores what comes of it: what became of it, in a word."""
    file = get(f"/instances/{instance}/file")
    if file is None:
        return "deleted"
    key = "orthanc-" + hashlib.sha256(file).hexdigest()
    try:
        job = service.wait(service.submit(file, key))
        try:
            outcome = store(service, job)
        except Erased:
            # Orthanc was away for longer than results are kept.
            job = service.wait(service.submit(file, key + "-after-" + job["id"]))
            outcome = store(service, job)
    except Refused as error:
        orthanc.LogWarning(f"medialrep: instance {instance} was refused: {error}")
        return "refused"
    orthanc.LogWarning(f"medialrep: instance {instance}, job {job['id']}: {outcome}")
    return outcome


def store(service, job):
    if stopping.is_set():
        raise Later("Orthanc stops")
    if job["state"] != "succeeded":
        return job["state"]
    # All of them first: what is stored is complete, or not begun.
    for result in [service.result(job, name) for name in RESULTS]:
        orthanc.RestApiPost("/instances", result)
    return "stored"


def treat(service, series):
    """Everything that is to be done about a series."""
    found = look(series)
    if found is None:
        return
    instances, last_update, _ = found
    outcomes = {bring_back(service, instance) for instance in instances}
    outcome = "-and-".join(sorted(outcomes - {"deleted"})) or "deleted"
    try:
        orthanc.RestApiPut(f"/series/{series}/metadata/{MARK}", f"{outcome} {last_update}".encode())
    except orthanc.OrthancException as error:
        raise Later(f"{outcome}, but cannot be marked: is {MARK} in UserMetadata?") from error


def work(service):
    while (series := waiting.take()) is not None:
        try:
            treat(service, series)
            waiting.done(series)
        except Exception as error:  # A hook must neither end nor take Orthanc down.
            why = str(error) if isinstance(error, Later) else type(error).__name__
            wait = waiting.later(series)
            if not stopping.is_set():
                orthanc.LogWarning(f"medialrep: series {series} waits for {wait} s: {why}")


def sweep(days):
    """Adds what was not brought to its end before Orthanc stopped."""
    oldest = time.strftime("%Y%m%dT%H%M%S", time.gmtime(time.time() - days * 24 * 60 * 60))
    query = json.dumps({"Level": "Series", "Query": {"Modality": "SEG"}})
    missed = 0
    for series in json.loads(orthanc.RestApiPost("/tools/find", query)):
        found = look(series)
        if found is None:
            continue
        _, last_update, mark = found
        if not mark.endswith(last_update) and last_update >= oldest:
            waiting.add(series)
            missed += 1
    orthanc.LogWarning(f"medialrep: {missed} series were not brought to their end before the start")


def run():
    try:
        settings = json.loads(orthanc.GetConfiguration())["Medialrep"]
        service = Service(settings)
    except (KeyError, OSError, ValueError) as error:
        orthanc.LogError(f"medialrep: section Medialrep of the configuration, or a file of it, is unusable: {error!r}")
        return
    for _ in range(THREADS):
        threading.Thread(target=work, args=(service,), daemon=True).start()
    sweep(settings.get("Days", 7))


def on_change(change, _level, resource):
    """Called in Orthanc's one thread of events: nothing is asked of anybody here."""
    if change == orthanc.ChangeType.ORTHANC_STARTED:
        threading.Thread(target=run, daemon=True).start()
    elif change == orthanc.ChangeType.STABLE_SERIES:
        waiting.add(resource)
    elif change == orthanc.ChangeType.ORTHANC_STOPPED:
        stopping.set()
        waiting.stop()


orthanc.RegisterOnChangeCallback(on_change)
