// SPDX-License-Identifier: Apache-2.0
import './style.css';
import { Page } from './page';

const host = document.getElementById('app');
if (host !== null) new Page().start(host);
