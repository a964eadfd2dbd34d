"""The live room: monitor core, bus, recorder, replay. Only bus, recorder, replay and service do input and output."""
