"""Topics on the wire: publishers and subscribers of CycloneDDS as ROS 2 makes them, and the node as a child process."""

import os
import subprocess
import threading
import time

from cyclonedds.domain import DomainParticipant
from cyclonedds.pub import DataWriter, Publisher
from cyclonedds.qos import Policy, Qos
from cyclonedds.sub import DataReader, Subscriber
from cyclonedds.topic import Topic
from cyclonedds.util import duration
from messages import message

# Not the domain of a robot that happens to run beside the test.
DOMAIN = int(os.environ.get("CAIRN_TEST_DOMAIN", "87"))
PLAIN = Policy.DataRepresentation(use_cdrv0_representation=True, use_xcdrv2_representation=False)


def qos(reliable=True, depth=100, latched=False):
    """A profile of ROS 2."""
    return Qos(
        Policy.Reliability.Reliable(duration(seconds=1)) if reliable else Policy.Reliability.BestEffort,
        Policy.Durability.TransientLocal if latched else Policy.Durability.Volatile,
        Policy.History.KeepLast(depth),
        PLAIN,
    )


class Wire:
    """A participant; what its subscribers receive is kept with the time of arrival."""

    def __init__(self):
        self.participant = DomainParticipant(DOMAIN)
        self.publisher, self.subscriber = Publisher(self.participant), Subscriber(self.participant)
        self.received, self.keep = {}, []

    def topic(self, name, kind, profile, prefix="rt", dds_name=None):
        return Topic(self.participant, f"{prefix}/{name.lstrip('/')}", message(kind, dds_name), qos=profile)

    def writer(self, name, kind, reliable=False, depth=30, latched=False, **other):
        profile = qos(reliable, depth, latched)
        writer = DataWriter(self.publisher, self.topic(name, kind, profile, **other), qos=profile)

        def write(ros):
            writer.write(message(kind, other.get("dds_name"))(ros))

        write.of = writer
        return write

    def listen(self, name, kind, reliable=True, latched=False, **other):
        """Collects what is published."""
        profile, into = qos(reliable, 1000, latched), self.received.setdefault(name, [])
        reader = DataReader(self.subscriber, self.topic(name, kind, profile, **other), qos=profile)
        self.keep.append(reader)
        ended = threading.Event()

        def poll():
            while not ended.is_set():
                for sample in reader.take(N=1000):
                    if getattr(sample, "ros", None) is not None:
                        into.append((time.time(), sample.ros))
                time.sleep(0.002)

        thread = threading.Thread(target=poll, daemon=True)
        thread.start()
        self.keep.append(ended)
        return into

    def close(self):
        for kept in self.keep:
            if isinstance(kept, threading.Event):
                kept.set()
        time.sleep(0.02)


class Node:
    """cairn-ros."""

    def __init__(self, *arguments):
        program = os.environ["CAIRN_ROS"]
        environment = {**os.environ, "ROS_DOMAIN_ID": str(DOMAIN)}
        self.child = subprocess.Popen(
            [program, *map(str, arguments)], stderr=subprocess.PIPE, text=True, env=environment
        )
        self.lines = []
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self):
        for line in self.child.stderr:
            self.lines.append(line.rstrip())

    def said(self, text):
        return any(text in line for line in self.lines)

    def memory_mb(self):
        with open(f"/proc/{self.child.pid}/status") as status:
            return int(next(line for line in status if line.startswith("VmRSS")).split()[1]) / 1024

    def cpu_s(self):
        with open(f"/proc/{self.child.pid}/stat") as stat:
            fields = stat.read().rsplit(")", 1)[1].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

    def end(self):
        """Ends it as Ctrl-C does; the exit code."""
        self.child.terminate()
        try:
            return self.child.wait(timeout=10)
        except subprocess.TimeoutExpired:
            self.child.kill()
            raise


def until(condition, seconds=20.0):
    """Waits; whether it came true."""
    end = time.time() + seconds
    while time.time() < end:
        if condition():
            return True
        time.sleep(0.02)
    return bool(condition())
