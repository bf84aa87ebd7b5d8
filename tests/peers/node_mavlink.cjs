// Reads frames from standard input, decodes each with node-mavlink and checks its signature; writes what it found as
// one JSON line, with a signed frame of its own. Arguments: the folder of node_modules, the key in hexadecimal.
const [folder, key] = process.argv.slice(2)
const { createRequire } = require('module')
const load = createRequire(folder + '/')
const { MavLinkPacketSplitter, MavLinkPacketParser, MavLinkProtocolV2, minimal, standard, common, ardupilotmega,
  development } = load('node-mavlink')

const registry = { ...minimal.REGISTRY, ...standard?.REGISTRY, ...common.REGISTRY, ...ardupilotmega.REGISTRY,
  ...development.REGISTRY }
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
