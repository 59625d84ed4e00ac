// ns-3's part of saturation.py: 802.11b stations in reach of each other that always have something to send.
//
// One line of JSON on stdout: what got through. See README.md for the load.
#include "ns3/core-module.h"
#include "ns3/mobility-module.h"
#include "ns3/network-module.h"
#include "ns3/wifi-module.h"

#include <cstdio>
#include <limits>

using namespace ns3;

namespace
{

const uint16_t PROTOCOL = 0x0810;
const char* RATE = "DsssRate1Mbps";

uint64_t octetsThrough = 0;

void
Count(Ptr<const Packet> packet, const Address&)
{
    octetsThrough += packet->GetSize();
}

// A frame is sent until it is acknowledged, without RTS, in one piece, and waits in its queue as long as it takes.
void
SetDefaults()
{
    uint32_t unlimited = std::numeric_limits<uint32_t>::max();
    Config::SetDefault("ns3::WifiRemoteStationManager::RtsCtsThreshold", UintegerValue(22000));
    Config::SetDefault("ns3::WifiRemoteStationManager::FragmentationThreshold", UintegerValue(22000));
    Config::SetDefault("ns3::WifiRemoteStationManager::MaxSlrc", UintegerValue(unlimited));
    Config::SetDefault("ns3::WifiRemoteStationManager::MaxSsrc", UintegerValue(unlimited));
    Config::SetDefault("ns3::WifiMacQueue::MaxDelay", TimeValue(Seconds(10000)));
}

NetDeviceContainer
Radios(NodeContainer nodes)
{
    MobilityHelper mobility;
    mobility.SetMobilityModel("ns3::ConstantPositionMobilityModel");
    mobility.Install(nodes);
    YansWifiChannelHelper channel;
    channel.SetPropagationDelay("ns3::ConstantSpeedPropagationDelayModel");
    channel.AddPropagationLoss("ns3::FixedRssLossModel", "Rss", DoubleValue(-50));
    YansWifiPhyHelper phy;
    phy.SetChannel(channel.Create());
    WifiHelper wifi;
    wifi.SetStandard(WIFI_STANDARD_80211b);
    wifi.SetRemoteStationManager("ns3::ConstantRateWifiManager",
                                 "DataMode", StringValue(RATE),
                                 "ControlMode", StringValue(RATE),
                                 "NonUnicastMode", StringValue(RATE));
    WifiMacHelper mac;
    mac.SetType("ns3::AdhocWifiMac");
    return wifi.Install(phy, mac, nodes);
}

} // namespace

int
main(int argc, char** argv)
{
    uint32_t count = 10;
    uint32_t octets = 1500;
    uint32_t seed = 1;
    double seconds = 60;
    double offered = 1.2; // more than the medium carries
    CommandLine command;
    command.AddValue("nodes", "how many", count);
    command.AddValue("octets", "octets of a payload", octets);
    command.AddValue("seconds", "s that are simulated", seconds);
    command.AddValue("offered", "Mb/s that all stations together are asked to send", offered);
    command.AddValue("seed", "number of the run", seed);
    command.Parse(argc, argv);
    RngSeedManager::SetRun(seed);
    SetDefaults();

    NodeContainer nodes(count);
    NetDeviceContainer devices = Radios(nodes);
    PacketSocketHelper sockets;
    sockets.Install(nodes);
    for (uint32_t i = 0; i < count; i++)
    {
        PacketSocketAddress next;
        next.SetSingleDevice(devices.Get(i)->GetIfIndex());
        next.SetPhysicalAddress(devices.Get((i + 1) % count)->GetAddress());
        next.SetProtocol(PROTOCOL);
        Ptr<PacketSocketClient> client = CreateObject<PacketSocketClient>();
        client->SetRemote(next);
        client->SetAttribute("PacketSize", UintegerValue(octets));
        client->SetAttribute("MaxPackets", UintegerValue(0));
        client->SetAttribute("Interval", TimeValue(Seconds(octets * 8.0 * count / (offered * 1e6))));
        nodes.Get(i)->AddApplication(client);
        PacketSocketAddress own;
        own.SetSingleDevice(devices.Get(i)->GetIfIndex());
        own.SetProtocol(PROTOCOL);
        Ptr<PacketSocketServer> server = CreateObject<PacketSocketServer>();
        server->SetLocal(own);
        server->TraceConnectWithoutContext("Rx", MakeCallback(&Count));
        nodes.Get(i)->AddApplication(server);
    }
    Simulator::Stop(Seconds(seconds));
    Simulator::Run();
    std::printf("{\"throughput_mbps\": %.5f}\n", octetsThrough * 8e-6 / seconds);
    Simulator::Destroy();
    return 0;
}
