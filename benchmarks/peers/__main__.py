"""The requirements of all peers, for pip: pip install $(python -m benchmarks.peers)"""

from __future__ import annotations

from benchmarks.peers import PEERS

if __name__ == "__main__":
    print(*dict.fromkeys(peer.requirement for peer in PEERS.values()))
