#include "saved_charge.h"

#include <cerrno>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <iomanip>
#include <limits>
#include <sstream>
#include <stdexcept>

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

namespace shsa_rover {

namespace {

const char kFormat[] = "soc_estimator-1";
const std::size_t kLongest = 1000;  // bytes

[[noreturn]] void fail(const std::string& path, const std::string& reason) {
  throw std::runtime_error(path + ": " + reason);
}

/// A descriptor that is closed in any case.
struct File {
  explicit File(int opened) : descriptor(opened) {}
  ~File() { if (descriptor >= 0) close(descriptor); }
  File(const File&) = delete;
  File& operator=(const File&) = delete;
  int descriptor;
};

bool between(double value, double low, double high) { return std::isfinite(value) && value >= low && value <= high; }

}  // namespace

void saveCharge(const std::string& path, const SavedCharge& charge) {
  std::ostringstream text;
  text << kFormat << std::setprecision(17) << '\n'
       << charge.state_of_charge << '\n' << charge.uncertainty << '\n' << charge.time << '\n' << charge.run << '\n';
  const std::string content = text.str();
  const std::string beside = path + ".new";
  struct stat about;
  if (lstat(path.c_str(), &about) == 0 && !S_ISREG(about.st_mode)) fail(path, "is no regular file");
  unlink(beside.c_str());
  {
    const File file(open(beside.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0600));
    if (file.descriptor < 0) fail(beside, std::strerror(errno));
    const ssize_t written = write(file.descriptor, content.data(), content.size());
    if (written != static_cast<ssize_t>(content.size()) || fsync(file.descriptor) != 0) {
      fail(beside, "cannot be written");
    }
  }
  if (std::rename(beside.c_str(), path.c_str()) != 0) fail(path, std::strerror(errno));
}

bool loadCharge(const std::string& path, SavedCharge& charge) {
  // O_NONBLOCK: a pipe would keep us waiting.
  const File file(open(path.c_str(), O_RDONLY | O_NONBLOCK | O_CLOEXEC));
  if (file.descriptor < 0) {
    if (errno == ENOENT) return false;
    fail(path, std::strerror(errno));
  }
  struct stat about;
  if (fstat(file.descriptor, &about) != 0 || !S_ISREG(about.st_mode)) fail(path, "is no regular file");
  if (about.st_uid != geteuid()) fail(path, "belongs to another user");
  std::string content(kLongest, '\0');
  const ssize_t length = read(file.descriptor, &content[0], content.size());
  if (length < 0) fail(path, std::strerror(errno));
  content.resize(static_cast<std::size_t>(length));
  std::istringstream text(content);
  std::string format;
  SavedCharge found;
  std::getline(text, format);
  text >> found.state_of_charge >> found.uncertainty >> found.time >> std::ws;
  std::getline(text, found.run);
  const bool good = format == kFormat && !text.fail() && between(found.state_of_charge, 0.0, 1.0) &&
                    between(found.uncertainty, 0.0, 1.0) &&
                    between(found.time, 0.0, std::numeric_limits<double>::max());
  if (!good) fail(path, "does not hold a state of charge");
  charge = found;
  return true;
}

}  // namespace shsa_rover
