!> Text from files and command lines, made safe for a terminal: control characters are shown, not sent.
module hb_printable
   implicit none
   private
   public :: printable

contains

   !> Returns a text with each control character except the end of a line in the form `\x1b`: those of ASCII and of
   !> Unicode (U+0080 to U+009F), those that change the direction of writing (U+202A to U+202E, U+2066 to U+2069), and
   !> bytes that are not UTF-8, which terminals of other encodings may interpret as control characters.
   pure function printable(text) result(shown)
      character(*), intent(in) :: text
      character(printable_length(text)) :: shown
      character(4*len(text)) :: buffer
      integer :: n

      call write_printable(text, buffer, n)
      shown = buffer
   end function printable

   pure integer function printable_length(text) result(n)
      character(*), intent(in) :: text
      character(4*len(text)) :: buffer

      call write_printable(text, buffer, n)
   end function printable_length

   pure subroutine write_printable(text, shown, n)
      character(*), intent(in) :: text
      character(*), intent(inout) :: shown
      integer, intent(out) :: n                             !! its length
      integer :: i, k, n_bytes

      n = 0
      i = 1
      do while (i <= len(text))
         n_bytes = bytes_of_character(text, i)
         if (n_bytes > 0) then
            shown(n + 1:n + n_bytes) = text(i:i + n_bytes - 1)
            n = n + n_bytes
         else
            n_bytes = max(1, -n_bytes)
            do k = i, i + n_bytes - 1
               write (shown(n + 1:n + 4), "(a, z2.2)") "\x", ichar(text(k:k))
               n = n + 4
            end do
         end if
         i = i + n_bytes
      end do
   end subroutine write_printable

   !> Number of bytes of the character that begins at a byte; negative if it must not be sent, 0 if it is not UTF-8.
   pure integer function bytes_of_character(text, i) result(n)
      character(*), intent(in) :: text
      integer, intent(in) :: i
      integer, parameter :: lowest_code(4) = [0, 128, 2048, 65536]    ! smallest code that needs as many bytes
      integer :: code, k

      code = ichar(text(i:i))
      select case (code)
      case (0:127)
         n = 1
         if ((code < 32 .and. code /= 10) .or. code == 127) n = -1
         return
      case (194:223)
         n = 2
         code = code - 192
      case (224:239)
         n = 3
         code = code - 224
      case (240:244)
         n = 4
         code = code - 240
      case default
         n = 0
         return
      end select
      do k = i + 1, i + n - 1
         if (k > len(text)) then
            n = 0
         else if (ichar(text(k:k))/64 /= 2) then
            n = 0
         end if
         if (n == 0) return
         code = 64*code + modulo(ichar(text(k:k)), 64)
      end do
      if (code < lowest_code(n) .or. code > 1114111 .or. code/2048 == 27) then ! too long a form, beyond Unicode, a surrogate
         n = 0
      else if (code < 160 .or. any(code == [8232, 8233]) .or. (code >= 8234 .and. code <= 8238) .or. &
               (code >= 8294 .and. code <= 8297)) then
         n = -n
      end if
   end function bytes_of_character
end module hb_printable
