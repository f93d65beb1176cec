"""Holds a recording against pymavlink: python3 record_compare.py DIALECTS LOG RECORDING

Every message of the log must be in the recording, in the same order for each type and component, every field equal.
Warnings are errors. Prints the number of messages compared.
"""

import importlib.util
import math
import os
import sys
import tempfile
import warnings
from collections import defaultdict

warnings.simplefilter("error")
os.environ["MAVLINK20"] = "1"

from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

with warnings.catch_warnings():
    warnings.simplefilter("ignore")
    from pymavlink import mavutil
    from pymavlink.generator import mavgen

ALL = """<?xml version="1.0"?>
<mavlink>
  <include>{0}/mavlink/ardupilotmega.xml</include>
  <include>{0}/mavlink/development.xml</include>
  <include>{0}/mavobserver.xml</include>
</mavlink>
"""


def dialect(folder):
    """pymavlink's classes for the definitions that the recording's schemas were made from."""
    work = tempfile.mkdtemp()
    xml, out = os.path.join(work, "everything.xml"), os.path.join(work, "everything.py")
    with open(xml, "w") as f:
        f.write(ALL.format(os.path.abspath(folder)))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        stdout, sys.stdout = sys.stdout, sys.stderr
        ok = mavgen.mavgen(mavgen.Opts(out, wire_protocol="2.0", language="Python3", validate=False), [xml])
        sys.stdout = stdout
    assert ok is not False, "the dialects do not generate"
    spec = importlib.util.spec_from_file_location("everything", out)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def from_log(path, module):
    mavutil.mavlink = module
    found = defaultdict(list)
    log = mavutil.mavlogfile(path, notimestamps=not path.endswith(".tlog"))
    log.mav = module.MAVLink(None)
    log.mav.robust_parsing = True
    bad = 0
    while True:
        message = log.recv_msg()
        if message is None:
            break
        kind = message.get_type()
        if kind == "BAD_DATA":
            bad += 1
        elif not kind.startswith("UNKNOWN"):
            key = (message.get_srcSystem(), message.get_srcComponent(), kind)
            found[key].append((message.get_seq(), message._timestamp, message))
    log.close()
    return found, bad


def from_recording(path):
    found = defaultdict(list)
    with open(path, "rb") as f:
        reader = make_reader(f, decoder_factories=[DecoderFactory()])
        assert reader.get_summary() is not None, "no summary"
        for decoded in reader.iter_decoded_messages(log_time_order=False):
            topic = decoded.channel.topic
            if topic.startswith("/mavlink/") and "/UNKNOWN_" not in topic:
                _, _, system, component, kind = topic.split("/")
                key = (int(system), int(component), kind)
                row = (decoded.message.sequence, decoded.message.log_time, decoded.decoded_message)
                found[key].append(row)
    return found


def equal(a, b):
    if isinstance(a, float) or isinstance(b, float):
        return a == b or (math.isnan(a) and math.isnan(b))
    if isinstance(a, list):
        b = list(b)
        return len(a) == len(b) and all(equal(x, y) for x, y in zip(a, b))
    if isinstance(a, str):
        return a == b or not a.isascii()
    return a == b


def main():
    folder, log, recording = sys.argv[1:]
    expected, bad = from_log(log, dialect(folder))
    actual = from_recording(recording)
    compared = 0
    for key in sorted(set(expected) | set(actual)):
        theirs, ours = expected.get(key, []), actual.get(key, [])
        assert len(theirs) == len(ours), f"{key}: pymavlink finds {len(theirs)}, the recording holds {len(ours)}"
        for (seq, stamp, message), (our_seq, our_time, our_message) in zip(theirs, ours):
            assert seq == our_seq, f"{key}: sequence {seq} {our_seq}"
            if log.endswith(".tlog"):
                assert abs(stamp * 1e9 - our_time) < 1000, f"{key}: time {stamp} {our_time}"
            for name in message.get_fieldnames():
                a, b = getattr(message, name), getattr(our_message, name)
                assert equal(a, b), f"{key} #{seq} {name}: {a!r} {b!r}"
            compared += 1
    print(compared, bad)


main()
