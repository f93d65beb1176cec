"""A ground station made of pymavlink: lists the parameters of component 191, sets one, asks for another interval.

Argument 1 is where the daemon listens, as pymavlink writes it. Prints "all well" at the end.
"""

import os
import sys
import time

os.environ["MAVLINK20"] = "1"
from pymavlink import mavutil

link = mavutil.mavlink_connection(sys.argv[1], source_system=255, source_component=190, dialect="ardupilotmega")
SYSTEM, US = 1, 191


def wait(kind, fits, again, seconds=20):
    """The first message that fits; asks again every second."""
    until, asked = time.time() + seconds, 0
    while time.time() < until:
        if time.time() - asked > 1:
            again()
            asked = time.time()
        message = link.recv_match(type=kind, blocking=True, timeout=0.2)
        if message and message.get_srcComponent() == US and fits(message):
            return message
    sys.exit(f"no {kind}")


found = {}
while True:
    def note(message):
        found[message.param_id] = message.param_value
        return len(found) == message.param_count

    wait("PARAM_VALUE", note, lambda: link.mav.param_request_list_send(SYSTEM, US))
    break
assert found["OUT_NAMED_HZ"] == 10.0, found

set_it = lambda: link.mav.param_set_send(SYSTEM, US, b"OUT_NAMED_HZ", 4.0, mavutil.mavlink.MAV_PARAM_TYPE_REAL32)
wait("PARAM_VALUE", lambda m: m.param_id == "OUT_NAMED_HZ" and m.param_value == 4.0, set_it)

command = mavutil.mavlink.MAV_CMD_SET_MESSAGE_INTERVAL
ask = lambda: link.mav.command_long_send(SYSTEM, US, command, 0, 250, 50000, 0, 0, 0, 0, 0)
wait("COMMAND_ACK", lambda m: m.command == command and m.result == 0, ask)

about = lambda: link.mav.command_long_send(SYSTEM, US, mavutil.mavlink.MAV_CMD_REQUEST_MESSAGE, 0, 244, 250, 0, 0, 0, 0, 0)
wait("MESSAGE_INTERVAL", lambda m: m.message_id == 250 and m.interval_us == 50000, about)
print("all well")
