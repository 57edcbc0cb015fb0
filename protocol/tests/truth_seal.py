#!/usr/bin/env python3
"""Sealed frames computed from RFC 8439 alone: the figures of tests/seal.rs.

Nothing here comes from the crate: ChaCha20, Poly1305 and the AEAD are written out from RFC 8439 (sections 2.3, 2.5, 2.8) and
held against the RFC's own example (2.8.2).
"""

import struct

MASK = 0xFFFFFFFF


def rotated(x, n):
    return (x << n | x >> 32 - n) & MASK


def quarter(s, a, b, c, d):
    for x, y, z, n in ((a, b, d, 16), (c, d, b, 12), (a, b, d, 8), (c, d, b, 7)):
        s[x] = (s[x] + s[y]) & MASK
        s[z] = rotated(s[z] ^ s[x], n)


def rounds(state):
    s = list(state)
    for _ in range(10):
        for column in range(4):
            quarter(s, column, 4 + column, 8 + column, 12 + column)
        for first in range(4):
            quarter(s, first, 4 + (first + 1) % 4, 8 + (first + 2) % 4, 12 + (first + 3) % 4)
    return s


def initial(key, sixteen):
    return struct.unpack("<4I", b"expand 32-byte k") + struct.unpack("<8I", key) + struct.unpack("<4I", sixteen)


def block(key, counter, nonce):
    start = initial(key, struct.pack("<I", counter) + nonce)
    return struct.pack("<16I", *((a + b) & MASK for a, b in zip(start, rounds(start))))


def chacha20(key, counter, nonce, text):
    stream = b"".join(block(key, counter + i, nonce) for i in range(-(-len(text) // 64)))
    return bytes(a ^ b for a, b in zip(text, stream))


def poly1305(key, text):
    r = int.from_bytes(key[:16], "little") & 0x0FFFFFFC0FFFFFFC0FFFFFFC0FFFFFFF
    total = 0
    for i in range(0, len(text), 16):
        total = (total + int.from_bytes(text[i : i + 16] + b"\x01", "little")) * r % (2**130 - 5)
    return ((total + int.from_bytes(key[16:], "little")) % 2**128).to_bytes(16, "little")


def aead(key, nonce, head, text):
    sealed = chacha20(key, 1, nonce, text)
    padded = lambda part: part + bytes(-len(part) % 16)
    lengths = struct.pack("<QQ", len(head), len(sealed))
    return sealed, poly1305(block(key, 0, nonce)[:32], padded(head) + padded(sealed) + lengths)


def check():
    key = bytes(range(0x80, 0xA0))
    nonce = bytes.fromhex("070000004041424344454647")
    head = bytes.fromhex("50515253c0c1c2c3c4c5c6c7")
    text = b"Ladies and Gentlemen of the class of '99: If I could offer you only one tip for the future, sunscreen would be it."
    sealed, tag = aead(key, nonce, head, text)
    assert sealed.startswith(bytes.fromhex("d31a8d34648e60db7b86afbc53ef7ec2"))
    assert tag == bytes.fromhex("1ae10b594f09e26a7e902ecbd0600691")


def derived(root, purpose, sender=0, epoch=0, receiver_epoch=0):
    return block(root, 0, b"SRK1" + struct.pack("<BHHHx", purpose, sender, epoch, receiver_epoch))[:32]


def frame(root, purpose, version, kind, flags, sender, epoch, receiver_epoch, sequence, body):
    head = b"SR" + struct.pack("<BBBHHIH", version, kind, flags, sender, epoch, sequence, len(body))
    session = derived(root, purpose, sender, epoch, receiver_epoch)
    sealed, tag = aead(session, bytes(8) + struct.pack("<I", sequence), head, body)
    return head + sealed + tag


if __name__ == "__main__":
    check()
    root = bytes(range(1, 33))
    heartbeat = bytes([2])
    print("up       ", frame(root, 1, 5, 1, 1, 3, 7, 9, 123456, heartbeat).hex())
    print("unbound  ", frame(root, 1, 5, 1, 3, 3, 7, 0, 123456, heartbeat).hex())
    print("down     ", frame(root, 2, 5, 2, 1, 0, 9, 7, 5, bytes([1])).hex())
    print("identify ", frame(root, 0, 0, 0, 1, 0, 9, 0, 5, bytes([1])).hex())
    print("fingerprint", derived(root, 4)[:8].hex())
