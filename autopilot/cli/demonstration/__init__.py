"""The demo, taken apart: its stage (processes and ports), its cast (identities), its story and its ending."""
