"""What other programs recorded, as ray maps: `raymap.foreign.zrd` reads Zemax ray databases,
`raymap.foreign.recorder` takes rays from programs that have a Python interface.
"""
