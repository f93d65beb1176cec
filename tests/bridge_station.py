"""A ground station that does at once what people do: wait for a vehicle, fetch its parameters, set one, command it,
upload a mission and fetch it again, through the address in argument 1. Prints what came back as one JSON object."""

import json
import os
import sys
import time

os.environ["MAVLINK20"] = "1"
from pymavlink import mavutil

link = mavutil.mavlink_connection(sys.argv[1], source_system=255, source_component=190, dialect="ardupilotmega")
mav, end = link.mav, time.time() + float(sys.argv[2])
spoke = 0.0


def wait(kinds, accept=lambda message: True, ask=lambda: None, again=2.0):
    """The next message of these kinds; asks again when none comes."""
    global spoke
    asked = 0.0
    while time.time() < end:
        if time.time() - spoke > 0.5:
            spoke = time.time()
            mav.heartbeat_send(6, 8, 0, 0, 4)
        if time.time() - asked > again:
            asked = time.time()
            ask()
        message = link.recv_match(type=kinds, blocking=True, timeout=0.1)
        if message is not None and message.get_srcSystem() == 1 and accept(message):
            return message
    raise SystemExit("no answer: %s" % kinds)


result = {}
wait("HEARTBEAT")
parameters, count = {}, 1


def fetch():
    if not parameters:
        mav.param_request_list_send(1, 1)
    else:
        for index in sorted(set(range(count)) - set(seen))[:10]:
            mav.param_request_read_send(1, 1, b"", index)


seen = []
while len(parameters) < count:
    value = wait("PARAM_VALUE", ask=fetch)
    count = value.param_count
    parameters[value.param_id] = value.param_value
    seen.append(value.param_index)
result["parameters"] = parameters
set_it = lambda: mav.param_set_send(1, 1, b"P007", 77.0, 9)
result["set"] = wait("PARAM_VALUE", lambda m: m.param_id == "P007" and m.param_value == 77.0, set_it).param_value
arm = lambda: mav.command_long_send(1, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0)
result["acknowledged"] = wait("COMMAND_ACK", lambda m: m.command == 400, arm).result

mission = [[16, 473977418 + 100 * i, 85455939 - 100 * i, 10.0 + i] for i in range(25)]
begin = lambda: mav.mission_count_send(1, 1, len(mission))
message = wait(["MISSION_REQUEST_INT", "MISSION_REQUEST", "MISSION_ACK"], ask=begin)
while message.get_type() != "MISSION_ACK":
    command, x, y, z = mission[message.seq]
    item = lambda: mav.mission_item_int_send(1, 1, message.seq, 3, command, 0, 1, 0, 0, 0, 0, x, y, z)
    last = message.seq
    fresh = lambda m: m.get_type() == "MISSION_ACK" or m.seq > last
    message = wait(["MISSION_REQUEST_INT", "MISSION_REQUEST", "MISSION_ACK"], fresh, item)
result["uploaded"] = message.type

back = []
count = wait("MISSION_COUNT", ask=lambda: mav.mission_request_list_send(1, 1)).count
for seq in range(count):
    item = wait("MISSION_ITEM_INT", lambda m: m.seq == seq, lambda: mav.mission_request_int_send(1, 1, seq))
    back.append([item.command, item.x, item.y, item.z])
result["fetched"] = back == mission
# whatever is dropped while the vehicle still speaks is the bridge's doing, so it stays until the vehicle has left
while time.time() < end and link.recv_match(blocking=True, timeout=1.0) is not None:
    pass
print(json.dumps(result), flush=True)
