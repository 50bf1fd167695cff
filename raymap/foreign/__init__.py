"""What other programs recorded, as ray maps.

`raymap.foreign.formats` finds the format of a file (`raymap.foreign.zrd` reads Zemax ray databases;
others register theirs under the entry-point group ``raymap.recorded_formats``),
`raymap.foreign.recorder` takes rays from programs that have a Python interface.
"""
