"""The peers: each a module with a class ``Peer``, which runs a setting on a case; imported in children only."""
