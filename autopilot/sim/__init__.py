"""A small world to fly in, all from one seed: an aircraft that speaks MAVLink, things on the ground, a router."""
