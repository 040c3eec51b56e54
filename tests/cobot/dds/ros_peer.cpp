// A ROS 2 node without ROS, on Fast DDS: the library under rmw_fastrtps. It is told what to do line by line.
//
//   pub|sub ID TOPIC TYPE DEPTH LATCHED RELIABLE      a writer or a reader; LATCHED and RELIABLE are 0 or 1
//   client ID SERVICE TYPE                            as rmw_fastrtps makes it; TYPE is pkg::srv::dds_::Name
//   write ID HEX | call ID TAG HEX                    CDR with its header of 4 bytes
//   matched ID                                        answers "matched ID WRITERS READERS"
//
// What comes in is printed: "sample ID NS HEX" with the wall clock's time, "reply ID TAG HEX", and "found|lost w|r TOPIC TYPE" for each
// endpoint of others.
#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/domain/DomainParticipantListener.hpp>
#include <fastdds/dds/publisher/DataWriter.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/DataReaderListener.hpp>
#include <fastdds/dds/subscriber/SampleInfo.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>
#include <fastdds/dds/topic/TopicDataType.hpp>
#include <fastdds/dds/topic/TypeSupport.hpp>
#include <fastdds/rtps/common/WriteParams.h>
#include <fastdds/rtps/reader/ReaderDiscoveryInfo.h>
#include <fastdds/rtps/transport/UDPv4TransportDescriptor.h>
#include <fastdds/rtps/writer/WriterDiscoveryInfo.h>

#include <chrono>
#include <cstdio>
#include <cstring>
#include <iostream>
#include <map>
#include <memory>
#include <mutex>
#include <sstream>
#include <string>
#include <vector>

using namespace eprosima::fastdds::dds;
using namespace eprosima::fastrtps::rtps;

using Bytes = std::vector<uint8_t>;
std::mutex turn;  // of stdout, and of the table of calls

constexpr uint32_t kLargest = 16u << 20;

// Passes CDR through as it is.
struct Raw : TopicDataType {
  explicit Raw(const std::string& name) {
    setName(name.c_str());
    m_typeSize = kLargest;
    m_isGetKeyDefined = false;
    auto_fill_type_object(false);
    auto_fill_type_information(false);
  }
  bool serialize(void* data, SerializedPayload_t* to) override {
    auto* bytes = static_cast<Bytes*>(data);
    if (bytes->size() > to->max_size) return false;
    memcpy(to->data, bytes->data(), bytes->size());
    to->length = static_cast<uint32_t>(bytes->size());
    to->encapsulation = CDR_LE;
    return true;
  }
  bool deserialize(SerializedPayload_t* from, void* data) override {
    static_cast<Bytes*>(data)->assign(from->data, from->data + from->length);
    return true;
  }
  std::function<uint32_t()> getSerializedSizeProvider(void* data) override {
    return [data] { return static_cast<uint32_t>(static_cast<Bytes*>(data)->size()); };
  }
  void* createData() override { return new Bytes; }
  void deleteData(void* data) override { delete static_cast<Bytes*>(data); }
  bool getKey(void*, InstanceHandle_t*, bool) override { return false; }
};

std::string hex(const Bytes& bytes) {
  static const char* digits = "0123456789abcdef";
  std::string text;
  text.reserve(2 * bytes.size());
  for (uint8_t byte : bytes) {
    text += digits[byte >> 4];
    text += digits[byte & 15];
  }
  return text;
}

Bytes bytes_of(const std::string& text) {
  Bytes bytes;
  for (size_t i = 0; i + 1 < text.size(); i += 2) bytes.push_back(std::stoi(text.substr(i, 2), nullptr, 16));
  return bytes;
}

long now_ns() {
  return std::chrono::nanoseconds(std::chrono::system_clock::now().time_since_epoch()).count();
}

void say(const std::string& line) {
  std::cout << line << "\n" << std::flush;
}

struct Endpoint : DataReaderListener {
  std::string id;
  DataWriter* writer = nullptr;
  DataReader* reader = nullptr;
  bool client = false;
  std::map<SequenceNumber_t, std::string> calls;

  void on_data_available(DataReader* from) override {
    Bytes bytes;
    SampleInfo info;
    while (from->take_next_sample(&bytes, &info) == ReturnCode_t::RETCODE_OK) {
      if (!info.valid_data) continue;
      std::lock_guard<std::mutex> mine(turn);
      if (!client) {
        say("sample " + id + " " + std::to_string(now_ns()) + " " + hex(bytes));
        continue;
      }
      const auto& related = info.related_sample_identity;  // rmw_fastrtps drops any other reply
      if (related.writer_guid() != from->guid() && related.writer_guid() != writer->guid()) continue;
      auto call = calls.find(related.sequence_number());
      if (call == calls.end()) continue;
      say("reply " + id + " " + call->second + " " + hex(bytes));
      calls.erase(call);
    }
  }
};

struct Discovery : DomainParticipantListener {
  void on_publisher_discovery(DomainParticipant*, WriterDiscoveryInfo&& found) override {
    const bool gone = found.status == WriterDiscoveryInfo::REMOVED_WRITER;
    tell(gone, "w", found.info.topicName().to_string(), found.info.typeName().to_string());
  }
  void on_subscriber_discovery(DomainParticipant*, ReaderDiscoveryInfo&& found) override {
    const bool gone = found.status == ReaderDiscoveryInfo::REMOVED_READER;
    tell(gone, "r", found.info.topicName().to_string(), found.info.typeName().to_string());
  }
  void tell(bool gone, const char* kind, const std::string& topic, const std::string& type) {
    std::lock_guard<std::mutex> mine(turn);
    say(std::string(gone ? "lost " : "found ") + kind + " " + topic + " " + type);
  }
};

struct Peer {
  Discovery discovery;
  DomainParticipant* participant;
  Publisher* publisher;
  Subscriber* subscriber;
  std::map<std::string, std::unique_ptr<Endpoint>> endpoints;

  explicit Peer(int domain) {
    DomainParticipantQos qos = PARTICIPANT_QOS_DEFAULT;
    const std::string enclave = "enclave=/;";
    qos.user_data().assign(enclave.begin(), enclave.end());
    qos.name("/");
    qos.transport().use_builtin_transports = false;
    auto udp = std::make_shared<eprosima::fastdds::rtps::UDPv4TransportDescriptor>();
    const char* localhost_only = std::getenv("ROS_LOCALHOST_ONLY");
    if (localhost_only == nullptr || std::string(localhost_only) != "0")
      udp->interfaceWhiteList.push_back("127.0.0.1");
    qos.transport().user_transports.push_back(udp);
    participant = DomainParticipantFactory::get_instance()->create_participant(
        domain, qos, &discovery, StatusMask::none());
    if (participant == nullptr) throw std::runtime_error("no participant");
    publisher = participant->create_publisher(PUBLISHER_QOS_DEFAULT);
    subscriber = participant->create_subscriber(SUBSCRIBER_QOS_DEFAULT);
  }

  Topic* topic(const std::string& name, const std::string& type) {
    if (auto* known = participant->lookup_topicdescription(name)) return static_cast<Topic*>(known);
    TypeSupport support(new Raw(type));
    support.register_type(participant);
    return participant->create_topic(name, type, TOPIC_QOS_DEFAULT);
  }

  DataWriter* writer(Topic* on, int depth, bool latched, bool reliable) {
    DataWriterQos qos = DATAWRITER_QOS_DEFAULT;
    qos.reliability().kind = reliable ? RELIABLE_RELIABILITY_QOS : BEST_EFFORT_RELIABILITY_QOS;
    qos.durability().kind = latched ? TRANSIENT_LOCAL_DURABILITY_QOS : VOLATILE_DURABILITY_QOS;
    qos.history().depth = depth;
    qos.endpoint().history_memory_policy = DYNAMIC_REUSABLE_MEMORY_MODE;
    qos.data_sharing().off();
    return publisher->create_datawriter(on, qos);
  }

  DataReader* reader(Topic* on, int depth, bool latched, bool reliable, Endpoint* listener) {
    DataReaderQos qos = DATAREADER_QOS_DEFAULT;
    qos.reliability().kind = reliable ? RELIABLE_RELIABILITY_QOS : BEST_EFFORT_RELIABILITY_QOS;
    qos.durability().kind = latched ? TRANSIENT_LOCAL_DURABILITY_QOS : VOLATILE_DURABILITY_QOS;
    qos.history().depth = depth;
    qos.endpoint().history_memory_policy = DYNAMIC_REUSABLE_MEMORY_MODE;
    qos.data_sharing().off();
    return subscriber->create_datareader(on, qos, listener, StatusMask::data_available());
  }

  void obey(const std::string& line) {
    std::istringstream words(line);
    std::string verb, id, name, type;
    words >> verb >> id;
    if (verb == "pub" || verb == "sub") {
      int depth, latched, reliable;
      words >> name >> type >> depth >> latched >> reliable;
      auto end = std::make_unique<Endpoint>();
      end->id = id;
      if (verb == "pub") end->writer = writer(topic(name, type), depth, latched, reliable);
      else end->reader = reader(topic(name, type), depth, latched, reliable, end.get());
      endpoints[id] = std::move(end);
    } else if (verb == "client") {
      words >> name >> type;
      auto end = std::make_unique<Endpoint>();
      end->id = id;
      end->client = true;
      end->writer = writer(topic("rq" + name + "Request", type + "_Request_"), 10, false, true);
      end->reader = reader(topic("rr" + name + "Reply", type + "_Response_"), 10, false, true, end.get());
      endpoints[id] = std::move(end);
    } else if (verb == "write") {
      words >> name;
      Bytes bytes = bytes_of(name);
      if (!endpoints.at(id)->writer->write(&bytes)) fail("write " + id);
    } else if (verb == "call") {
      std::string payload;
      words >> name >> payload;
      Endpoint& end = *endpoints.at(id);
      Bytes bytes = bytes_of(payload);
      WriteParams parameters;
      parameters.related_sample_identity().writer_guid() = end.reader->guid();
      std::lock_guard<std::mutex> mine(turn);
      if (!end.writer->write(&bytes, parameters)) say("failed call " + id);
      else end.calls[parameters.sample_identity().sequence_number()] = name;
    } else if (verb == "matched") {
      Endpoint& end = *endpoints.at(id);
      PublicationMatchedStatus readers;
      SubscriptionMatchedStatus writers;
      if (end.writer) end.writer->get_publication_matched_status(readers);
      if (end.reader) end.reader->get_subscription_matched_status(writers);
      std::lock_guard<std::mutex> mine(turn);
      say("matched " + id + " " + std::to_string(writers.current_count) + " " +
          std::to_string(readers.current_count));
    } else {
      fail(verb);
    }
  }

  void fail(const std::string& what) {
    std::lock_guard<std::mutex> mine(turn);
    say("failed " + what);
  }
};

int main(int argc, char** argv) {
  Peer peer(argc > 1 ? std::atoi(argv[1]) : 0);
  {
    std::lock_guard<std::mutex> mine(turn);
    say("ready");
  }
  for (std::string line; std::getline(std::cin, line);) peer.obey(line);
  DomainParticipantFactory::get_instance();
  peer.participant->delete_contained_entities();
  DomainParticipantFactory::get_instance()->delete_participant(peer.participant);
  std::fflush(stdout);
  std::_Exit(0);
}
