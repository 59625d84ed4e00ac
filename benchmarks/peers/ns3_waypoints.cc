// ns-3's part of waypoints.py: nodes that walk to random points and send a payload a second each, by AODV over 802.11b.
//
// One line of JSON on stdout: what was simulated, and what was sent and received. See README.md for the load.
#include "ns3/aodv-module.h"
#include "ns3/core-module.h"
#include "ns3/internet-module.h"
#include "ns3/mobility-module.h"
#include "ns3/network-module.h"
#include "ns3/wifi-module.h"

#include <cstdio>
#include <string>
#include <vector>

using namespace ns3;

namespace
{

const uint16_t PORT = 9000;
const char* RATE = "DsssRate1Mbps";

uint64_t sent = 0;
uint64_t received = 0;
uint64_t frames = 0;

void
Receive(Ptr<Socket> socket)
{
    Address from;
    while (socket->RecvFrom(from))
    {
        received++;
    }
}

void
Send(Ptr<Socket> socket, uint32_t octets)
{
    socket->Send(Create<Packet>(octets));
    sent++;
    Simulator::Schedule(Seconds(1), &Send, socket, octets);
}

void
CountFrame(Ptr<const Packet>, double)
{
    frames++;
}

// Walks at 1 m/s to a random point of the square, waits there for 2 s, and walks on.
void
Walk(NodeContainer nodes, double side)
{
    std::string anywhere = "ns3::UniformRandomVariable[Min=0.0|Max=" + std::to_string(side) + "]";
    ObjectFactory places("ns3::RandomRectanglePositionAllocator");
    places.Set("X", StringValue(anywhere));
    places.Set("Y", StringValue(anywhere));
    Ptr<PositionAllocator> points = places.Create<PositionAllocator>();
    MobilityHelper mobility;
    mobility.SetMobilityModel("ns3::RandomWaypointMobilityModel",
                              "Speed", StringValue("ns3::ConstantRandomVariable[Constant=1.0]"),
                              "Pause", StringValue("ns3::ConstantRandomVariable[Constant=2.0]"),
                              "PositionAllocator", PointerValue(points));
    mobility.SetPositionAllocator(points);
    mobility.Install(nodes);
}

// 802.11b at 1 Mb/s, ad hoc; signals fade with distance^3 and travel at the speed of light, as ns-3 has it by default.
NetDeviceContainer
Radios(NodeContainer nodes)
{
    YansWifiChannelHelper channel = YansWifiChannelHelper::Default();
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
    NetDeviceContainer devices = wifi.Install(phy, mac, nodes);
    Config::ConnectWithoutContext("/NodeList/*/DeviceList/*/$ns3::WifiNetDevice/Phy/PhyTxBegin",
                                  MakeCallback(&CountFrame));
    return devices;
}

Ptr<Socket>
Udp(Ptr<Node> node)
{
    return Socket::CreateSocket(node, TypeId::LookupByName("ns3::UdpSocketFactory"));
}

} // namespace

int
main(int argc, char** argv)
{
    uint32_t count = 9;
    uint32_t octets = 100;
    uint32_t seed = 1;
    double side = 150;
    double seconds = 60;
    std::string to = "all";
    CommandLine command;
    command.AddValue("nodes", "how many", count);
    command.AddValue("side", "m, of the square", side);
    command.AddValue("seconds", "s that are simulated", seconds);
    command.AddValue("octets", "octets of a payload", octets);
    command.AddValue("to", "all: one hop, to whoever hears it; first: by AODV to the first node", to);
    command.AddValue("seed", "number of the run", seed);
    command.Parse(argc, argv);
    RngSeedManager::SetRun(seed);

    NodeContainer nodes(count);
    Walk(nodes, side);
    NetDeviceContainer devices = Radios(nodes);
    AodvHelper aodv; // sends hellos
    aodv.Set("EnableBroadcast", BooleanValue(false)); // payloads to all are not passed on
    InternetStackHelper internet;
    internet.SetRoutingHelper(aodv);
    internet.Install(nodes);
    Ipv4AddressHelper addresses("10.1.0.0", "255.255.0.0");
    Ipv4InterfaceContainer interfaces = addresses.Assign(devices);
    Ipv4Address destination = to == "all" ? Ipv4Address::GetBroadcast() : interfaces.GetAddress(0);

    Ptr<UniformRandomVariable> phase = CreateObject<UniformRandomVariable>();
    std::vector<Ptr<Socket>> sockets;
    for (uint32_t i = 0; i < count; i++)
    {
        Ptr<Socket> in = Udp(nodes.Get(i));
        in->Bind(InetSocketAddress(Ipv4Address::GetAny(), PORT));
        in->SetRecvCallback(MakeCallback(&Receive));
        sockets.push_back(in);
        if (to != "all" && i == 0)
        {
            continue; // the destination sends nothing itself
        }
        Ptr<Socket> out = Udp(nodes.Get(i));
        out->SetAllowBroadcast(true);
        out->Connect(InetSocketAddress(destination, PORT));
        sockets.push_back(out);
        Simulator::ScheduleWithContext(i, Seconds(phase->GetValue(0, 1)), &Send, out, octets);
    }
    Simulator::Stop(Seconds(seconds));
    Simulator::Run();
    std::printf("{\"sent\": %lu, \"received\": %lu, \"frames\": %lu, \"received_per_payload\": %.4f}\n",
                (unsigned long)sent,
                (unsigned long)received,
                (unsigned long)frames,
                (double)received / (double)sent);
    Simulator::Destroy();
    return 0;
}
