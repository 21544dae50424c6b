"""The bridge of deploy/plant for tests: started, heard, configured; and its simulated OPC UA server."""
import ctypes
import json
import struct
import subprocess
import threading
import time

from documentation import free_port
from service_support import ServiceCase
from support import REPOSITORY

PLANT = REPOSITORY / "deploy" / "plant"


def locked_packages():
    """Installs the bridge's locked npm packages if they are not there; why they cannot be, in words."""
    installed = PLANT / "node_modules" / ".package-lock.json"
    if installed.exists() and installed.stat().st_mtime >= (PLANT / "package-lock.json").stat().st_mtime:
        return None
    try:
        done = subprocess.run(["npm", "ci", "--no-audit", "--no-fund"], cwd=PLANT, capture_output=True, text=True, timeout=200)
    except (OSError, subprocess.TimeoutExpired) as error:
        return f"npm ci: {error} (no network?)"
    return None if done.returncode == 0 else f"npm ci failed (no network?): {done.stderr[-300:]}"


class LibmodbusServer:
    """libmodbus's own server: a float at holding register 100, another at input register 40 with its low word first."""

    class Mapping(ctypes.Structure):
        _fields_ = [*((name, ctypes.c_int) for name in ("nb_bits", "start_bits", "nb_input_bits", "start_input_bits", "nb_input_registers",
                                                        "start_input_registers", "nb_registers", "start_registers")),
                    *((name, ctypes.c_void_p) for name in ("tab_bits", "tab_input_bits")),
                    *((name, ctypes.POINTER(ctypes.c_uint16)) for name in ("tab_input_registers", "tab_registers"))]

    def __init__(self, library, holding, input):
        self.library, self.port = library, free_port()
        library.modbus_new_tcp.restype = ctypes.c_void_p
        library.modbus_mapping_new.restype = ctypes.POINTER(self.Mapping)
        self.context = ctypes.c_void_p(library.modbus_new_tcp(b"127.0.0.1", self.port))
        self.mapping = library.modbus_mapping_new(0, 0, 110, 50)
        contents = self.mapping.contents
        contents.tab_registers[100], contents.tab_registers[101] = struct.unpack(">HH", struct.pack(">f", holding))
        contents.tab_input_registers[41], contents.tab_input_registers[40] = struct.unpack(">HH", struct.pack(">f", input))
        self.listener = library.modbus_tcp_listen(self.context, 1)
        assert self.listener >= 0
        threading.Thread(target=self.serve, daemon=True).start()

    def serve(self):
        query = ctypes.create_string_buffer(260)
        while self.library.modbus_tcp_accept(self.context, ctypes.byref(ctypes.c_int(self.listener))) >= 0:
            while (length := self.library.modbus_receive(self.context, query)) >= 0:
                self.library.modbus_reply(self.context, query, length, self.mapping)


class PlantCase(ServiceCase):
    seconds = 0  # how long a test lasts by its clock

    def need_packages(self):
        missing = locked_packages()
        if missing:
            self.skipTest(missing)

    def write_configuration(self):
        (self.folder / "plant.json").write_text(json.dumps(self.configuration, indent=1))

    def bridge(self, *arguments):
        with open(self.folder / "bridge.log", "a") as log:
            process = subprocess.Popen(["node", PLANT / "knothe-plant.mjs", "plant.json", *arguments], cwd=self.folder, stdin=subprocess.DEVNULL, stdout=log, stderr=log)
        self.addCleanup(lambda: process.poll() is None and (process.kill(), process.wait()))
        return process

    def bridge_said(self):
        return (self.folder / "bridge.log").read_text()

    def refused(self, status, *texts):
        (self.folder / "bridge.log").unlink(missing_ok=True)
        self.assertEqual(self.bridge().wait(60), status, self.bridge_said())
        for text in texts:
            self.assertIn(text, self.bridge_said())

    def wait_until(self, condition, seconds=120):
        end = time.monotonic() + seconds + self.seconds
        while not condition():
            assert time.monotonic() < end, self.bridge_said()[-4000:]
            time.sleep(0.02)

    def opcua_server(self):
        """The simulated server, which takes its nodes' signals as a line, and its port."""
        said = self.folder / "opcua.log"
        for port in (free_port() for _ in range(5)):  # one that was free may be taken meanwhile
            with open(said, "w") as log:
                server = subprocess.Popen(["node", PLANT / "test" / "opcua_server.mjs", str(port), self.folder], stdin=subprocess.PIPE, stdout=log, stderr=log)
            self.addCleanup(lambda server=server: (server.kill(), server.wait(), server.stdin.close()))
            end = time.monotonic() + 40
            while server.poll() is None and time.monotonic() < end and "listening" not in said.read_text():
                time.sleep(0.02)
            if "listening" in said.read_text():
                return server, port
            server.kill()
        self.fail(said.read_text()[-4000:])

    def libmodbus_server(self, *values):
        try:
            return LibmodbusServer(ctypes.CDLL("libmodbus.so.5"), *values)
        except OSError:
            self.skipTest("the Debian package libmodbus5 is not installed")
