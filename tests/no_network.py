"""Processes to which the kernel gives no socket to the network."""

import ctypes
import errno
import platform
import socket
import struct

SOCKET_CALL = {"x86_64": 41, "aarch64": 198}.get(platform.machine())
"""Number of the system call; None where it is not known, and nothing is forbidden."""
SET_NO_NEW_PRIVILEGES, SET_SECCOMP, FILTER = 38, 22, 2
LOAD, JUMP_IF_EQUAL, RETURN = 0x20, 0x15, 0x06
NUMBER, FIRST_ARGUMENT = 0, 16
"""Offsets in what the kernel tells a filter of a system call."""
ALLOW, REFUSE = 0x7FFF0000, 0x00050000 | errno.EACCES

_libc = ctypes.CDLL(None, use_errno=True)


def forbid_network() -> None:
    """Has the kernel refuse this process, and all it starts, any socket but AF_UNIX.

    For the `preexec_fn` of `subprocess`: it holds for compiled libraries too. COLMAP asks for one
    when it is loaded, to see whether there is IPv6.
    """
    if SOCKET_CALL is None:
        return
    program = [
        (LOAD, 0, 0, NUMBER),
        (JUMP_IF_EQUAL, 0, 3, SOCKET_CALL),
        (LOAD, 0, 0, FIRST_ARGUMENT),
        (JUMP_IF_EQUAL, 1, 0, int(socket.AF_UNIX)),
        (RETURN, 0, 0, REFUSE),
        (RETURN, 0, 0, ALLOW),
    ]
    code = ctypes.create_string_buffer(b"".join(struct.pack("HBBI", *one) for one in program))
    table = ctypes.create_string_buffer(struct.pack("HP", len(program), ctypes.addressof(code)))
    _libc.prctl(SET_NO_NEW_PRIVILEGES, 1, 0, 0, 0)
    _libc.prctl(SET_SECCOMP, FILTER, table, 0, 0)  # where it fails, the test of sockets says so
