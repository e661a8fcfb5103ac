#!/usr/bin/env python3
"""What check.sh runs for one hook, in a network of its own: check.py short|long HOOK FOLDER."""

import base64
import collections
import contextlib
import http.client
import json
import os
import pathlib
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time

import make_seg

HERE = pathlib.Path(__file__).resolve().parent
# Every series that comes back, by its modality, beside the one that was sent.
COMPLETE = {"SEG": 1, "OT": 1, "DOC": 1, "SR": 1, "M3D": 1}
# A segmentation that is not sent, or that is refused.
ALONE = {"SEG": 1}
# Edge of a voxel in mm whose job runs for some seconds: time to kill.
SLOW = 0.3
# Seconds that something is away, and that its results may take afterwards: tries come at growing distances.
AWAY = {"short": 6, "long": 75}
PATIENCE = {"short": 90, "long": 300}
# Seconds after which nothing more may come.
REST = 4


class Miss(Exception):
    """A case that did not end as it must."""


class Process:
    """One side: a script of this folder that becomes the program."""

    def __init__(self, command, log, ready):
        self.command, self.log, self.ready, self.process = command, log, ready, None

    def start(self):
        with open(self.log, "ab") as log:
            self.process = subprocess.Popen(self.command, stdout=log, stderr=log)
        wait_for(f"{self.command[0].name} is ready", self.is_ready, 60)

    def is_ready(self):
        if self.process.poll() is not None:
            raise Miss(f"{self.command[0].name} ended with {self.process.returncode}")
        with contextlib.suppress(OSError, http.client.HTTPException):
            return self.ready()
        return False

    def end(self, by=signal.SIGTERM):
        if self.process is not None and self.process.poll() is None:
            self.process.send_signal(by)
            self.process.wait(60)


def wait_for(what, test, seconds):
    end = time.monotonic() + seconds
    while not (answer := test()):
        if time.monotonic() > end:
            raise Miss(f"not after {seconds} s: {what}")
        time.sleep(0.1)
    return answer


def ask(port, authorization, method, path, body=None):
    """Status and bytes of an answer."""
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=30)
    try:
        connection.request(method, path, body, {"Authorization": authorization})
        answer = connection.getresponse()
        return answer.status, answer.read()
    finally:
        connection.close()


class Recipe:
    """Both sides, with what a test asks them."""

    def __init__(self, length, hook, folder):
        self.length, self.hook, self.folder = length, hook, folder
        self.service = Process([HERE / "service.sh", folder], folder / "service.log", self.service_is_ready)
        self.orthanc = Process([HERE / "orthanc.sh", folder, hook], folder / "orthanc.log", self.orthanc_is_ready)
        # By the name of what was sent: what its study must have in the end.
        self.expected = {}

    def service_is_ready(self):
        return self.ask_service("GET", "/readyz")[0] == 200

    def orthanc_is_ready(self):
        return self.ask_orthanc("GET", "/system")[0] == 200

    def ask_service(self, method, path):
        return ask(8080, "Bearer " + (self.folder / "token").read_text().strip(), method, path)

    def ask_orthanc(self, method, path, body=None):
        user = base64.b64encode((self.folder / "credentials").read_bytes().strip()).decode()
        return ask(8042, "Basic " + user, method, path, body)

    def json_of(self, asking, *request):
        status, body = asking(*request)
        if status != 200:
            raise Miss(f"{request[0]} {request[1]} is answered with {status}")
        return json.loads(body)

    def jobs(self):
        return self.json_of(self.ask_service, "GET", "/v1/jobs?limit=200")["jobs"]

    def put(self, file):
        """Into Orthanc by its REST interface."""
        self.json_of(self.ask_orthanc, "POST", "/instances", file)

    def send(self, name, **other):
        self.put(make_seg.file_bytes(name, **other))
        self.expected[name] = COMPLETE

    def send_by_dicom(self, name, **other):
        """Into Orthanc by C-STORE."""
        with tempfile.NamedTemporaryFile(dir=self.folder, suffix=".dcm") as file:
            file.write(make_seg.file_bytes(name, **other))
            file.flush()
            # -R: only the class of this file is proposed; storescu's own list ends before segmentations.
            command = ["storescu", "-R", "-aec", "ORTHANC", "127.0.0.1", "4242", file.name]
            subprocess.run(command, check=True, timeout=60, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        self.expected[name] = COMPLETE

    def in_study(self, name):
        """How many instances of each modality its study has."""
        query = {"Level": "Series", "Expand": True, "Query": {"StudyInstanceUID": make_seg.uid(name, "study")}}
        count = collections.Counter()
        for series in self.json_of(self.ask_orthanc, "POST", "/tools/find", json.dumps(query)):
            count[series["MainDicomTags"]["Modality"]] += len(series["Instances"])
        return dict(count)

    def expect(self, *names):
        for name in names:
            what = f"results of {name} in its study"
            wait_for(what, lambda: self.in_study(name) == self.expected[name], PATIENCE[self.length])

    def expect_running(self):
        wait_for("a job runs", lambda: any(job["state"] == "running" for job in self.jobs()), 30)

    def away(self, seconds=None):
        time.sleep(AWAY[self.length] if seconds is None else seconds)

    # The cases.

    def comes_by_rest(self):
        self.send("rest")
        self.expect("rest")

    def comes_by_dicom(self):
        self.send_by_dicom("dicom", transfer=make_seg.IMPLICIT)
        self.expect("dicom")

    def grows(self):
        self.send("grows")
        self.expect("grows")
        self.put(make_seg.file_bytes("grows", number=2))
        self.expected["grows"] = {modality: 2 for modality in COMPLETE}
        self.expect("grows")

    def unusable(self):
        """One of ours and one that cannot be read; then one whose results show that their turn has passed."""
        before = len(self.jobs())
        self.put(make_seg.file_bytes("own", manufacturer="medialrep"))
        self.put(make_seg.file_bytes("unreadable").replace(b"BINARY", b"BINERY"))
        self.expected.update({"own": ALONE, "unreadable": ALONE})
        self.send("after-them")
        self.expect("after-them")
        if (count := len(self.jobs()) - before) != 1:
            raise Miss(f"{count} jobs were made of one segmentation")

    def orthanc_killed(self, name="orthanc-killed", by=signal.SIGKILL):
        self.send(name, spacing=SLOW)
        self.expect_running()
        self.orthanc.end(by)
        self.away()
        self.orthanc.start()
        self.expect(name)

    def service_killed(self, name="service-killed", by=signal.SIGKILL):
        self.send(name, spacing=SLOW)
        self.expect_running()
        self.service.end(by)
        self.away(1)
        self.service.start()
        self.expect(name)

    def service_killed_sending(self, name="service-killed-sending"):
        """What a service that is gone was about to deliver is not waited for."""
        before = len(self.jobs())
        self.send(name)
        wait_for("it is a job", lambda: len(self.jobs()) > before, PATIENCE[self.length])
        wait_for("the job has succeeded", lambda: self.jobs()[0]["state"] == "succeeded", PATIENCE[self.length])
        self.service.end(signal.SIGKILL)
        self.service.start()
        self.expect(name)

    def service_away(self, name="service-away", by=signal.SIGTERM):
        self.service.end(by)
        self.send(name)
        self.away()
        self.service.start()
        self.expect(name)

    def both_away(self, name="both-away"):
        """Orthanc ends before the series is at rest, and the service is not there."""
        self.service.end()
        self.send(name)
        self.orthanc.end(signal.SIGKILL)
        self.orthanc.start()
        self.away(1)
        self.service.start()
        self.expect(name)

    def killed_while_storing(self):
        """Either side is killed at moments from the arrival of the series to that of the last result."""
        for turn in range(12):
            name = f"storing-{turn}"
            self.send(name)
            time.sleep(0.5 * turn)
            side = (self.orthanc, self.service)[turn % 2]
            side.end(signal.SIGKILL)
            side.start()
            self.expect(name)

    def once_each(self):
        """Nothing came twice, nowhere, of all that was sent before."""
        time.sleep(REST)
        for name, expected in self.expected.items():
            if (found := self.in_study(name)) != expected:
                raise Miss(f"the study of {name} has {found}")
        found = len(self.json_of(self.ask_orthanc, "GET", "/studies"))
        if found != len(self.expected):
            raise Miss(f"there are {found} studies, not {len(self.expected)}")

    def sends_nothing_again(self):
        self.orthanc.end()
        begin = self.orthanc.log.stat().st_size
        self.orthanc.start()
        # The Lua hooks hear of one that cannot be read only that it was refused, and try again for hours.
        expected = 0 if self.hook == "python" else 1
        line = f"medialrep: {expected} series were not "
        wait_for(line, lambda: line.encode() in self.orthanc.log.read_bytes()[begin:], 10)

    def silent_logs(self):
        """No name, no number of a patient, no secret in what either side wrote."""
        secrets = [(self.folder / file).read_bytes().strip() for file in ("token", "password")]
        for log in (self.orthanc.log, self.service.log):
            text = log.read_bytes()
            if any(word in text for word in [b"RECIPE", *secrets]):
                raise Miss(f"{log.name} has a patient or a secret")


def cases(recipe):
    yield "a segmentation comes by REST, its results come back", recipe.comes_by_rest
    if shutil.which("storescu"):
        yield "a segmentation comes by C-STORE, its results come back", recipe.comes_by_dicom
    yield "a series grows, each result comes once", recipe.grows
    yield "one of ours is not sent, one that cannot be read holds up no other", recipe.unusable
    yield "Orthanc is killed while a job runs, and is away", recipe.orthanc_killed
    yield "the service is killed while a job runs", recipe.service_killed
    yield "the service is killed while results are sent", recipe.service_killed_sending
    yield "the service is away when a segmentation comes", recipe.service_away
    yield "Orthanc is killed before a series is at rest, the service is away", recipe.both_away
    if recipe.length == "long":
        stop = signal.SIGTERM
        yield "Orthanc is stopped while a job runs, and is away", lambda: recipe.orthanc_killed("orthanc-stopped", stop)
        yield "the service is stopped while a job runs", lambda: recipe.service_killed("service-stopped", stop)
        kill = signal.SIGKILL
        yield "the service is killed and away when one comes", lambda: recipe.service_away("killed-away", kill)
        yield "either is killed while results are stored", recipe.killed_while_storing
    yield "each result is stored once", recipe.once_each
    yield "what was taken is not sent again when Orthanc starts again", recipe.sends_nothing_again
    yield "the logs have no patient and no secret", recipe.silent_logs


@contextlib.contextmanager
def heart_beat(recipe):
    """Calls the Lua hooks as a timer does, for an Orthanc that does not do so itself."""
    over = threading.Event()

    def beat():
        command = [HERE / "sweep.sh", "http://127.0.0.1:8042", recipe.folder / "credentials"]
        while not over.wait(3):
            subprocess.run(command, check=False, stderr=subprocess.DEVNULL)

    thread = threading.Thread(target=beat)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()


def needs_sweeps(recipe):
    version = recipe.json_of(recipe.ask_orthanc, "GET", "/system")["Version"]
    numbers = tuple(int(part) for part in version.split(".")[:3] if part.isdigit())
    return recipe.hook != "python" and numbers < (1, 11, 1)


def run(recipe):
    """Whether all cases ended well."""
    is_well = True
    recipe.service.start()
    recipe.orthanc.start()
    with heart_beat(recipe) if needs_sweeps(recipe) else contextlib.nullcontext():
        for what, case in cases(recipe):
            started = time.monotonic()
            try:
                case()
                print(f"orthanc: ok: {recipe.hook}: {what} ({time.monotonic() - started:.0f} s)", flush=True)
            except Exception as error:  # The others are run all the same.
                is_well = False
                print(f"orthanc: FAILED: {recipe.hook}: {what}: {error or type(error).__name__}", flush=True)
                for side in (recipe.service, recipe.orthanc):
                    if side.process.poll() is not None:
                        side.start()
    return is_well


def told_to_end(*_):
    """By an exception, so that both sides are ended."""
    sys.exit(f"orthanc: FAILED: {sys.argv[2]}: told to end before all was tried")


def main():
    length, hook, folder = sys.argv[1], sys.argv[2], pathlib.Path(sys.argv[3])
    folder.mkdir(parents=True, exist_ok=True)
    os.environ.setdefault("ORTHANC_STABLE_AGE", "1")
    os.environ.setdefault("ORTHANC_HEART_BEAT", "3")
    recipe = Recipe(length, hook, folder)
    signal.signal(signal.SIGTERM, told_to_end)
    try:
        is_well = run(recipe)
    finally:
        recipe.orthanc.end(signal.SIGKILL)
        recipe.service.end(signal.SIGKILL)
    sys.exit(0 if is_well else 1)


if __name__ == "__main__":
    main()
