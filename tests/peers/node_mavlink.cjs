// Reads frames from standard input, decodes each with node-mavlink and checks its signature; writes what it found as
// one JSON line, with a signed frame of its own. Arguments: the folder of node_modules, the key in hexadecimal.
const [folder, key] = process.argv.slice(2)
const { createRequire } = require('module')
const load = createRequire(folder + '/')
const { MavLinkPacketSplitter, MavLinkPacketParser, MavLinkProtocolV2, minimal, standard, common, ardupilotmega,
  development } = load('node-mavlink')

const { MavLinkData, MavLinkPacketField } = load('mavlink-mappings/dist/lib/mavlink')

// Newer than the package's dialects; TARGET_RELATIVE is in its development dialect.
class OnboardComputerStatus extends MavLinkData {}
OnboardComputerStatus.MSG_ID = 390
OnboardComputerStatus.MSG_NAME = 'ONBOARD_COMPUTER_STATUS'
OnboardComputerStatus.MAGIC_NUMBER = 156
OnboardComputerStatus.FIELDS = [
  new MavLinkPacketField('time_usec', 'timeUsec', 0, false, 8, 'uint64_t', 'us'),
  new MavLinkPacketField('uptime', 'uptime', 8, false, 4, 'uint32_t', 'ms'),
  new MavLinkPacketField('ram_usage', 'ramUsage', 12, false, 4, 'uint32_t', 'MiB'),
  new MavLinkPacketField('ram_total', 'ramTotal', 16, false, 4, 'uint32_t', 'MiB'),
  new MavLinkPacketField('cpu_cores', 'cpuCores', 197, false, 1, 'uint8_t[]', '%', 8),
]

const registry = { ...minimal.REGISTRY, ...standard?.REGISTRY, ...common.REGISTRY, ...ardupilotmega.REGISTRY,
  ...development.REGISTRY, 390: OnboardComputerStatus }
const secret = Buffer.from(key, 'hex')
const found = []
const plain = (_, value) => typeof value === 'bigint' ? Number(value) : value
const parser = process.stdin.pipe(new MavLinkPacketSplitter({}, { magicNumbers: numbers() }))
  .pipe(new MavLinkPacketParser())

function numbers() {
  return Object.fromEntries(Object.values(registry).map(c => [c.MSG_ID, c.MAGIC_NUMBER]))
}

parser.on('data', packet => {
  const kind = registry[packet.header.msgid]
  found.push({
    name: kind ? kind.MSG_NAME : String(packet.header.msgid),
    system: packet.header.sysid,
    component: packet.header.compid,
    signed: packet.signature ? packet.signature.matches(secret) : null,
    forged: packet.signature ? packet.signature.matches(Buffer.alloc(32, 1)) : null,
    fields: kind ? packet.protocol.data(packet.payload, kind) : null,
  })
})
parser.on('end', () => {
  const ping = new common.Ping()
  Object.assign(ping, { timeUsec: 7n, seq: 5, targetSystem: 0, targetComponent: 0 })
  const protocol = new MavLinkProtocolV2(255, 190, MavLinkProtocolV2.IFLAG_SIGNED)
  const signed = protocol.sign(protocol.serialize(ping, 1), 3, secret)
  console.log(JSON.stringify({ found, signed: signed.toString('hex') }, plain))
})
