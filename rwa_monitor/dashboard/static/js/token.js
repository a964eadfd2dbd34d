/** The token for changes comes in the address that was printed at the start; kept for this tab, out of the address bar. */
export function takeToken() {
  const match = /[#&]token=([^&]+)/.exec(location.hash);
  if (!match) return;
  sessionStorage.setItem("token", decodeURIComponent(match[1]));
  history.replaceState(null, "", "#/");
}

export const setToken = (text) => sessionStorage.setItem("token", text.trim());

export const token = () => sessionStorage.getItem("token") ?? "";
