"""Files of trained splats to arrays: one module per format, `splat_file` for any of them.

Every size is known before it is allocated: counts in headers are compared with what the file holds, and compressed
data is unpacked up to the size that the header implies and no further.
"""
