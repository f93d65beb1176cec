"""A vehicle for stations to talk to: heartbeats, parameters, commands and missions, through the address in argument 1.

Prints one JSON object when it has heard everything that a station does at its start, or after the seconds in
argument 2: what was asked of it, and the mission that it holds.
"""

import json
import os
import sys
import time

os.environ["MAVLINK20"] = "1"
from pymavlink import mavutil

PARAMETERS = {"P%03d" % i: i * 0.5 for i in range(60)}
address, patience = sys.argv[1], float(sys.argv[2])
link = mavutil.mavlink_connection(address, source_system=1, source_component=1, dialect="ardupilotmega")
mav = link.mav
done = {"station_heartbeats": 0, "parameters_asked": 0, "commands": [], "mission": []}
wanted, mission, items, spoke = 0, [], {}, 0.0
end = time.time() + patience


def finished():
    return done["station_heartbeats"] and done["parameters_asked"] and done["commands"] and done["mission"]


def send_parameter(name):
    index = sorted(PARAMETERS).index(name)
    mav.param_value_send(name.encode(), PARAMETERS[name], 9, len(PARAMETERS), index)


grace = None
while time.time() < end and (grace is None or time.time() < grace):
    if grace is None and finished():
        # the last answers have to arrive
        grace = time.time() + 3
    if time.time() - spoke > 0.2:
        spoke = time.time()
        mav.heartbeat_send(2, 3, 81, 0, 4)
    message = link.recv_match(blocking=True, timeout=0.05)
    if message is None:
        continue
    kind, source = message.get_type(), (message.get_srcSystem(), message.get_srcComponent())
    if kind == "HEARTBEAT" and message.type == 6:
        done["station_heartbeats"] += 1
    elif kind == "PARAM_REQUEST_LIST":
        done["parameters_asked"] += 1
        for name in sorted(PARAMETERS):
            send_parameter(name)
            time.sleep(0.002)
    elif kind == "PARAM_REQUEST_READ":
        names = sorted(PARAMETERS)
        name = names[message.param_index] if message.param_index >= 0 else message.param_id
        if name in PARAMETERS:
            send_parameter(name)
    elif kind == "PARAM_SET" and message.param_id in PARAMETERS:
        PARAMETERS[message.param_id] = message.param_value
        send_parameter(message.param_id)
    elif kind == "COMMAND_LONG":
        done["commands"].append(message.command)
        mav.command_ack_send(message.command, 0, 0, 0, source[0], source[1])
    elif kind == "MISSION_COUNT":
        wanted, items = message.count, {}
        mav.mission_request_int_send(source[0], source[1], 0)
    elif kind in ("MISSION_ITEM_INT", "MISSION_ITEM"):
        scale = 1 if kind == "MISSION_ITEM_INT" else 1e7
        items[message.seq] = [message.command, round(message.x * scale), round(message.y * scale), message.z]
        if len(items) < wanted:
            mav.mission_request_int_send(source[0], source[1], len(items))
        else:
            mission = [items[i] for i in range(wanted)]
            done["mission"] = mission
            mav.mission_ack_send(source[0], source[1], 0)
    elif kind == "MISSION_REQUEST_LIST":
        mav.mission_count_send(source[0], source[1], len(mission))
    elif kind in ("MISSION_REQUEST_INT", "MISSION_REQUEST") and message.seq < len(mission):
        command, x, y, z = mission[message.seq]
        mav.mission_item_int_send(source[0], source[1], message.seq, 3, command, 0, 1, 0, 0, 0, 0, x, y, z)
print(json.dumps(done), flush=True)
